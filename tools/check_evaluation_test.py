"""The checker of the evaluation's page: what it must find, and that its mark comes and goes."""

import unittest

from check_evaluation import MARK, figures_on, hash_of, marked, problems

GOLDEN = "weighted 38ef 6.9\n"
ROWS = "# what there must be\n3.1\n5.7\n5.8\n3.12\n3.13\n5.26\ncube\n"
PAGE = f"""# Evaluation

Every figure.

**Arithmetic:** `tests/contact/golden.txt` of hash `{hash_of(GOLDEN)}`; if that is not today's, it says so.

Drawn, in the report only: 3.1, 4.4-4.8, 3.7/3.8.

| figure | claim | we measure | verdict |
|---|---|---|---|
| 5.7-5.8 | a \\| b | 1 | agrees |
| 3.12/3.13 | c | 2 | differs |
| 5.26d | d | 3 | even |
| cube | e | 4 | worse |
"""


class CheckEvaluationTest(unittest.TestCase):
    def test_a_page_of_today_passes(self):
        self.assertEqual(list(problems(PAGE, GOLDEN, ROWS)), [])
        self.assertEqual(marked(PAGE, GOLDEN), PAGE)

    def test_a_page_of_other_arithmetic_is_found_and_marked(self):
        changed = GOLDEN.replace("38ef", "38ee")
        self.assertEqual(len(list(problems(PAGE, changed, ROWS))), 2)  # old, and does not say so
        said = marked(PAGE, changed)
        self.assertTrue(said.startswith(f"# Evaluation\n\n{MARK}Every figure."), said[:300])
        self.assertEqual(marked(said, changed), said)
        self.assertEqual(len(list(problems(said, changed, ROWS))), 1)
        # Back to the old arithmetic, the page is right again.
        self.assertEqual(marked(said, GOLDEN), PAGE)
        self.assertEqual(len(list(problems(said, GOLDEN, ROWS))), 1)

    def test_a_page_without_a_hash_is_old(self):
        page = PAGE.replace("**Arithmetic:**", "")
        self.assertNotEqual(marked(page, GOLDEN), page)

    def test_missing_figures(self):
        for row in ("| cube |", "| 5.26d |", "| 5.7-5.8 |", "3.1, "):
            found = list(problems(PAGE.replace(row, "| x |"), GOLDEN, ROWS))
            self.assertEqual(len(found), 1, row)
            self.assertIn("lacks", found[0])

    def test_ranges_and_parts(self):
        figures = figures_on(PAGE)
        self.assertLessEqual({"4.4", "4.6", "4.8", "3.7", "3.8", "5.7", "5.8", "5.26"}, figures)
        self.assertFalse({"4.9", "5.9", "4.3"} & figures)


if __name__ == "__main__":
    unittest.main()
