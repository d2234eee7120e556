"""The module checker itself: what it must refuse and what it must let pass."""

import unittest

from check_modules import (BELOW, SHARED_PRIVATE, SMALL, allowed_modules, check_named_files, check_rooms, check_text,
                           unused, uses)


def problems(name, *lines):
    return [problem for _, problem in check_text(name, "\n".join(lines))]


class CheckModulesTest(unittest.TestCase):
    def assert_refused(self, name, line, part):
        found = problems(name, line)
        self.assertEqual(len(found), 1, f"{name}: {line}")
        self.assertIn(part, found[0])

    def assert_passes(self, name, line):
        self.assertEqual(problems(name, line), [], f"{name}: {line}")

    def test_no_module_is_above_itself(self):
        for module in BELOW:
            for below in allowed_modules(module) - {module}:
                self.assertNotIn(module, allowed_modules(below), f"{module} and {below} form a cycle")

    def test_downward_passes(self):
        self.assert_passes("src/contact/a.cpp", '#include "palpate/cloud/point_cloud.h"')
        self.assert_passes("src/contact/a.cpp", '#include "palpate/core/core.h"')
        self.assert_passes("include/palpate/io/a.h", '#include "palpate/tool/tool.h"')
        self.assert_passes("apps/a.cpp", '#include "scenes/scene.h"')

    def test_upward_is_refused(self):
        self.assert_refused("src/math/a.cpp", '#include "palpate/contact/b.h"', "may not include")
        self.assert_refused("src/cloud/a.cpp", '#include "palpate/tool/b.h"', "may not include")
        self.assert_refused("src/contact/a.cpp", '#include "palpate/io/b.h"', "may not include")
        self.assert_refused("scenes/a.cpp", '#include "palpate/io/b.h"', "may not include")
        self.assert_refused("src/core/a.cpp", '#include "tests/test_util/b.h"', "may not include")

    def test_line_number_and_spacing(self):
        text = '// first\n#  include   "palpate/io/b.h"'
        self.assertEqual([number for number, _ in check_text("src/mesh/a.cpp", text)], [2])

    def test_private_headers(self):
        self.assert_passes("src/mesh/a.cpp", '#include "src/mesh/b.h"')
        self.assert_passes("tests/mesh/a.cpp", '#include "src/mesh/b.h"')
        self.assert_passes("src/contact/a.cpp", '#include "src/core/internal/simd.h"')
        self.assert_refused("src/contact/a.cpp", '#include "src/mesh/b.h"', "private to mesh")
        self.assert_refused("eval/a.cpp", '#include "src/contact/hull/b.h"', "private to contact")
        self.assert_passes("eval/a.cpp", '#include "src/contact/points/scan/point_scan.h"')
        self.assert_refused("tests/mesh/a.cpp", '#include "src/packing/b.h"', "private headers of packing")
        self.assert_refused("include/palpate/mesh/a.h", '#include "src/mesh/b.h"', "public header")

    def test_tests_and_benchmarks_do_without_the_evaluation(self):
        self.assert_refused("tests/contact/a.cpp", '#include "eval/studies/b.h"', "may not include eval")
        self.assert_refused("tests/test_util/a.h", '#include "eval/studies/b.h"', "may not include eval")
        self.assert_refused("bench/field_bench.cpp", '#include "eval/studies/b.h"', "may not include eval")
        self.assert_passes("tests/eval/a.cpp", '#include "eval/studies/b.h"')
        self.assert_passes("bench/contact_bench.cpp", '#include "eval/studies/b.h"')

    def test_permissions_that_nobody_needs_are_refused(self):
        used = {(header, module) for header, modules in SHARED_PRIVATE.items() for module in modules}
        header, (module, *_) = next(iter(SHARED_PRIVATE.items()))
        before = set(unused(used, {}))
        self.assertFalse(any(header in problem for problem in before))
        self.assertIn(header, (set(unused(used - {(header, module)}, {})) - before).pop())
        lines = '#include "src/core/internal/simd.h"\n#include <zlib.h>'
        self.assertEqual(set(uses("src/cloud/a.cpp", lines)), {("src/core/internal/simd.h", "cloud"), (r"zlib\.h", "cloud")})
        self.assertEqual(set(uses("tests/cloud/a.cpp", lines)), {("src/core/internal/simd.h", "cloud")})

    def test_libraries(self):
        self.assert_passes("src/io/a.cpp", "#include <png.h>")
        self.assert_passes("tests/cloud/a.cpp", "#include <gtest/gtest.h>")
        self.assert_passes("src/contact/a_cuda.cu", "#include <cuda_runtime.h>")
        self.assert_refused("src/mesh/a.cpp", "#include <png.h>", "only in io")
        self.assert_refused("src/io/a.cpp", "#include <embree3/rtcore.h>", "only in scenes")
        self.assert_refused("src/contact/a.cpp", "#include <cuda_runtime.h>", "CUDA headers")
        self.assert_refused("include/palpate/io/a.h", "#include <png.h>", "public headers")
        self.assert_refused("scenes/scene.h", "#include <embree3/rtcore.h>", "public headers")

    def test_named_files(self):
        ends = {"src/io/ros/cdr.h", "ros/cdr.h", "cdr.h"}
        text = "// (ros/cdr.h)\n// see io/cdr.h.\nint a;  // of hd.h\n"
        self.assertEqual(list(check_named_files(text, ends)), [(2, "there is no io/cdr.h: name a file that is there")])

    def test_rooms(self):
        full = {f"src/io/{i}.cpp": 400 for i in range(20)}
        self.assertEqual(list(check_rooms(full)), [])
        [(name, problem)] = check_rooms({**full, "src/io/more.h": 20})
        self.assertEqual((name, problem[:8]), ("src/io", "21 files"))
        [(name, problem)] = check_rooms({**full, "src/io/0.cpp": 401})
        self.assertEqual((name, problem[:9]), ("src/io/0.cpp", "401 lines"))
        [(name, problem)] = check_rooms({"src/io/a.h": 19, "src/io/b.h": 20, SMALL[0]: 19, "tests/io/c.h": 1})
        self.assertEqual((name, problem[:8]), ("src/io/a.h", "19 lines"))
        self.assertFalse(any(SMALL[0] in problem for problem in unused(set(), {SMALL[0]: 19})))
        self.assertTrue(any(SMALL[0] in problem for problem in unused(set(), {SMALL[0]: 20})))
        [(name, problem)] = check_rooms({"tests/io/a_test.cpp": 600, "tests/io/b_test.cpp": 601})
        self.assertEqual((name, problem[:9]), ("tests/io/b_test.cpp", "601 lines"))

    def test_unknown_places(self):
        self.assert_refused("src/mesh/a.cpp", '#include "b.h"', "path from the root")
        self.assert_refused("src/attic/a.cpp", "#include <vector>", "no module attic")


if __name__ == "__main__":
    unittest.main()
