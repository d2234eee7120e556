#!/usr/bin/env python3
"""Lists the files that make up the project: what git tracks or would track, or, in a copy without
git, everything outside the folders that are made here.

usage: tools/project_files.py [SUFFIX ...]      e.g. tools/project_files.py .h .cpp
"""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MADE_HERE = {".git", ".cache", "build", "demo", "node_modules", "__pycache__"}


def project_files(root=ROOT):
    """Paths relative to `root`, sorted."""
    git = subprocess.run(
        ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        check=False,
    ) if (root / ".git").exists() else None
    if git is not None and git.returncode == 0:
        names = [Path(name.decode()) for name in git.stdout.split(b"\0") if name]
    else:
        names = [path.relative_to(root) for path in root.rglob("*")]
        names = [name for name in names if not MADE_HERE.intersection(name.parts)]
    return sorted(name for name in names if (root / name).is_file())


if __name__ == "__main__":
    for name in project_files():
        if len(sys.argv) == 1 or name.suffix in sys.argv[1:]:
            print(name)
