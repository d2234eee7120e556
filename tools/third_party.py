#!/usr/bin/env python3
"""What others wrote and the program contains or links: licenses/third_party.json is the list.

usage: tools/third_party.py write              writes THIRD_PARTY.md, which palpate --licenses prints
       tools/third_party.py check BUILD        is everything in the list that a build really used? The
                                               headers its compiler read, the libraries of the program,
                                               the packages in the viewer's page. 77: cannot be known here
       tools/third_party.py spdx BUILD FILE    the list in SPDX 2.3, with the versions of this machine
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PARTIES = json.loads((ROOT / "licenses/third_party.json").read_text())
NOTICES = ROOT / "THIRD_PARTY.md"
HOW = {
    "page": "In the viewer's page, inside the program",
    "headers": "Compiled into the program",
    "web": "Compiled into palpate.wasm, besides LLVM's C++ library",
    "module": "Compiled into the Python module",
    "linked": "Linked, and shipped in the Python package alone",
}


def notices():
    """The text of THIRD_PARTY.md."""
    lines = ["# Third-party software", "",
             "Palpate itself is licensed under Apache-2.0. It contains and uses the following work of others. Made by",
             "`tools/third_party.py` from `licenses/third_party.json`.", ""]
    for how, title in HOW.items():
        lines += [f"## {title}", "", "| name | license | copyright |", "|---|---|---|"]
        for party in PARTIES:
            if party["how"] == how:
                copyright_ = "; ".join(party["copyright"])
                lines.append(f"| [{party['name']}]({party['url']}) | {party['spdx']} | {copyright_} |")
        lines.append("")
    lines += ["The Python package has these libraries inside, but for the C and GCC runtime, with those that they need; what",
              "their authors ask to be said lies in its folder `licenses`.", ""]
    lines += ["A build with CUDA also contains the CUDA runtime, © NVIDIA Corporation, under the CUDA Toolkit's license",
              "agreement.", ""]
    for spdx in sorted({p["spdx"] for p in PARTIES if p["how"] != "linked"}):
        names = ", ".join(p["name"] for p in PARTIES if p["spdx"] == spdx and p["how"] != "linked")
        text = (ROOT / f"licenses/{spdx}.txt").read_text().rstrip()
        lines += [f"## {spdx}", "", f"For {names}; the copyright is that of the table.", "", "```", text, "```", ""]
    return "\n".join(lines)


def run(*command, accept=(0,)):
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode not in accept:
        raise SystemExit(f"third_party: {' '.join(command[:3])} ...: {result.stderr.strip()}")
    return result.stdout


def used_headers(build):
    """Headers outside of the project that objects of the library and the program were made from."""
    headers, is_ours = set(), False
    for line in run("ninja", "-C", str(build), "-t", "deps").splitlines():
        if not line.startswith(" "):
            is_ours = not line.startswith(("tests/", "bench/", "ninja:"))
        elif is_ours and line.strip():
            path = Path(os.path.normpath(build / line.strip()))
            if not path.is_relative_to(ROOT):
                headers.add(str(path))
    return sorted(headers)


def problems(build):
    """What a build uses and the list does not have."""
    known = {package for party in PARTIES for package in party.get("debian", ())}
    owners = {}
    headers = used_headers(build)
    for line in run("dpkg", "-S", *headers, accept=(0, 1)).splitlines():
        packages, _, path = line.rpartition(": ")
        owners[path] = {package.split(":")[0] for package in packages.split(", ")}
    for path in headers:
        if path in owners and not owners[path] & known:
            yield f"{path} of {', '.join(sorted(owners[path]))} is compiled in"

    known = {library for party in PARTIES for library in party.get("libraries", ())}
    for name in re.findall(r"NEEDED.*\[(.*)\]", run("readelf", "-d", str(build / "bin/palpate"))):
        if name.split(".so")[0] not in known:
            yield f"{name} is linked"

    known = {party.get("npm") for party in PARTIES}
    lock = json.loads((ROOT / "web/package-lock.json").read_text())
    for path, package in lock["packages"].items():
        name = path.rpartition("node_modules/")[2]
        if name and not package.get("dev") and name not in known:
            yield f"the npm package {name} is in the page"


def version_of(party):
    if "npm" in party:
        lock = json.loads((ROOT / "web/package-lock.json").read_text())
        return lock["packages"]["node_modules/" + party["npm"]]["version"]
    for package in party["debian"]:
        out = run("dpkg-query", "-W", "-f=${Version}", package, accept=(0, 1))
        if out:
            return out
    return "NOASSERTION"


def spdx_document(version):
    """The list as an SPDX document of the package palpate."""
    def package(name, number, license_, url, copyright_):
        key = re.sub(r"[^A-Za-z0-9.]+", "-", name).strip("-")
        return {"SPDXID": f"SPDXRef-{key}", "name": name, "versionInfo": number, "downloadLocation": url,
                "licenseDeclared": license_, "licenseConcluded": license_, "copyrightText": copyright_,
                "filesAnalyzed": False}

    palpate = package("palpate", version, "Apache-2.0", "NOASSERTION", "the authors of Palpate")
    parties = [p for p in PARTIES if p["how"] != "web"]  # palpate.wasm is no part of that package
    others = [package(p["name"], version_of(p), p["spdx"], p["url"],
                      "; ".join("Copyright " + c for c in p["copyright"])) for p in parties]
    kinds = {"page": "CONTAINS", "headers": "CONTAINS", "module": "CONTAINS", "linked": "DYNAMIC_LINK"}
    return {
        "spdxVersion": "SPDX-2.3", "dataLicense": "CC0-1.0", "SPDXID": "SPDXRef-DOCUMENT",
        "name": f"palpate-{version}", "documentNamespace": f"https://spdx.org/spdxdocs/palpate-{version}",
        "creationInfo": {"created": "1970-01-01T00:00:00Z", "creators": ["Tool: tools/third_party.py"]},
        "packages": [palpate] + others,
        "relationships": [{"spdxElementId": "SPDXRef-DOCUMENT", "relationshipType": "DESCRIBES",
                           "relatedSpdxElement": palpate["SPDXID"]}] +
                         [{"spdxElementId": palpate["SPDXID"], "relationshipType": kinds[p["how"]],
                           "relatedSpdxElement": o["SPDXID"]} for p, o in zip(parties, others)],
    }


def main(arguments):
    match arguments:
        case ["write"]:
            NOTICES.write_text(notices())
        case ["spdx", build, file]:
            version = re.search(r"CMAKE_PROJECT_VERSION:STATIC=(.*)",
                                (Path(build) / "CMakeCache.txt").read_text())[1]
            Path(file).write_text(json.dumps(spdx_document(version), indent=1) + "\n")
        case ["check", build]:
            build = Path(build).resolve()
            for tool in ("dpkg", "ninja", "readelf"):
                if subprocess.run(["which", tool], capture_output=True, check=False).returncode != 0:
                    print(f"SKIPPED: there is no {tool}")
                    return 77
            found = list(problems(build))
            if NOTICES.read_text() != notices():
                found.append("THIRD_PARTY.md is not what the list says: run tools/third_party.py write")
            for problem in found:
                print(f"third_party: {problem}; name it in licenses/third_party.json")
            print(f"third_party: {len(PARTIES)} parties, {len(found)} problems")
            return 1 if found else 0
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
