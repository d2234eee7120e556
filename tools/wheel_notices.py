#!/usr/bin/env python3
"""Adds to a wheel what the authors of the libraries inside ask us to say: the copyright files of the
Debian packages that auditwheel took them from.

usage: tools/wheel_notices.py WHEEL
"""

import base64
import hashlib
import json
import re
import sys
import zipfile
from pathlib import Path


def main(wheel):
    with zipfile.ZipFile(wheel) as archive:
        files = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
        modes = {info.filename: info.external_attr for info in archive.infolist()}
    record = next(name for name in files if name.endswith(".dist-info/RECORD"))
    folder = record.rpartition("/")[0]
    bill = json.loads(files[f"{folder}/sboms/auditwheel.cdx.json"])
    packages = {match[1] for part in bill["components"]
                if (match := re.match(r"pkg:deb/\w+/([^@?]+)", part.get("purl", "")))}
    num_libraries = sum(".libs/" in name for name in files)
    for package in sorted(packages):
        notice = Path(f"/usr/share/doc/{package}/copyright")
        if not notice.exists():
            sys.exit(f"wheel_notices: {notice} is missing; install the package {package} again")
        name = f"{folder}/licenses/{package}.txt"
        files[name] = notice.read_bytes()
        digest = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest()).rstrip(b"=").decode()
        files[record] += f"{name},sha256={digest},{len(files[name])}\n".encode()
    if len(packages) == 0 and num_libraries > 0:
        sys.exit(f"wheel_notices: nothing says where the {num_libraries} libraries in {wheel} come from")
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, (2020, 1, 1, 0, 0, 0))
            info.external_attr = modes.get(name, 0o644 << 16)
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    print(f"wheel_notices: {len(packages)} packages of {num_libraries} libraries")


if __name__ == "__main__":
    main(sys.argv[1]) if len(sys.argv) == 2 else sys.exit(__doc__)
