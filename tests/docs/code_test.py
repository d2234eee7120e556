#!/usr/bin/env python3
"""Compiles every C++ block of README and guides against the public headers.

usage: tests/docs/code_test.py CXX [PAGE ...]

The blocks of a page are one function, in their order. What a page takes for granted (a tool, an
image, a pose) is declared below.
"""
import re
import subprocess
import sys
from pathlib import Path

from commands_test import FENCE, ROOT, pages

INCLUDE = re.compile(r'^#include .*$', re.M)
GIVEN = """
#include <cstdio>
#include <memory>
#include <utility>
#include <vector>
#include "palpate/palpate.h"
#include "palpate/contact/body_contact.h"
using namespace palpate;
extern Tool tool, object, left_tool, right_tool, block_tool;
extern Sensor sensor;
extern Contact contact;
extern SurfaceEstimator surface;
extern DepthField field;
extern std::unique_ptr<ContactQuery> left_query, right_query;
extern DepthImageView image;
extern DepthFrame frame;
extern DepthStreamInfo stream_info;
extern TimeOptions options;
extern ThreadPool pool;
extern std::uint16_t* counts;
extern Pose X_WT, X_WB, X_WL, X_WR;
extern double now, arrival;
std::vector<Pose> candidates();
std::vector<SurfaceView> all_cameras();
std::vector<std::int32_t> nearest_camera(const std::vector<Pose>&);
extern const Pose* X_WT_on_gpu;
extern const std::int32_t* surface_on_gpu;
extern std::size_t num;
extern BatchAnswers answers_on_gpu;
"""
# `stream` is a depth stream in some pages and a CUDA stream in another.
GIVEN_BY_PAGE = {"batches.md": "extern void* stream;\n"}


def main():
    compiler = sys.argv[1]
    chosen = [Path(page).resolve() for page in sys.argv[2:]] or pages()
    num_failed = num_blocks = 0
    for page in chosen:
        text = page.read_text()
        blocks = [(text.count("\n", 0, m.start()) + 2, m.group(2)) for m in FENCE.finditer(text)
                  if m.group(1) == "cpp"]
        if not blocks:
            continue
        num_blocks += len(blocks)
        name = page.relative_to(ROOT)
        code = GIVEN + GIVEN_BY_PAGE.get(page.name, "extern DepthStreamInfo stream;\n")
        code += "\n".join(line for _, body in blocks for line in INCLUDE.findall(body))
        code += "\nvoid as_a_reader_writes_it();\nvoid as_a_reader_writes_it() {\n"
        for line, body in blocks:
            code += f'#line {line} "{name}"\n' + INCLUDE.sub("", body)
        code += "\n}\n"
        compiled = subprocess.run([compiler, "-std=c++20", "-fsyntax-only", "-Wall", "-Wextra",
                                   "-Wno-unused", "-Werror", f"-I{ROOT}/include", "-x", "c++", "-"],
                                  input=code, text=True, stderr=subprocess.PIPE)
        print(f"{name}: {len(blocks)} blocks: {compiled.returncode}")
        if compiled.returncode != 0:
            print(compiled.stderr)
            num_failed += 1
    print(f"{num_blocks} blocks, {num_failed} pages failed")
    return 1 if num_failed or num_blocks == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
