"""The program palpate that is inside this package."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def main() -> None:
    """Becomes the program, with the same arguments; poses in Parquet are measured from here."""
    from palpate import _query

    if _query.is_requested(sys.argv[1:]):
        sys.exit(_query.main())
    program = Path(__file__).parent / "bin" / "palpate"
    os.execv(program, [str(program), *sys.argv[1:]])
