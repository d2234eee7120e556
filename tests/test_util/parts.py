"""Tests in Python in parts that CTest runs side by side (palpate_test_in_parts).

PALPATE_PART=2/3 is the second of three parts: every third test from the second on. Without it all run."""

import os
import unittest


def share(everything):
    """Returns the elements of a list that belong to this part."""
    part, parts = map(int, os.environ.get("PALPATE_PART", "1/1").split("/"))
    return list(everything)[part - 1::parts]


class Loader(unittest.TestLoader):
    def getTestCaseNames(self, case):
        return share(super().getTestCaseNames(case))
