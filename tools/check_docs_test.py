"""The checker of pages itself: what it must find and what it must pass by."""

import tempfile
import unittest
from pathlib import Path

from check_docs import anchors, problems, tests_of

TESTS = {("Suite", "HoldsWhatItSays"), ("Other", "GoesOnAfterIt")}


class CheckDocsTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        (self.root / "docs").mkdir()
        (self.root / "docs/there.md").write_text("# One heading, and `code`\n")
        (self.root / "tools").mkdir()
        (self.root / "tools/lint.sh").write_text("")

    def found(self, page):
        return [number for number, _ in problems(page, Path("docs/page.md"), self.root, TESTS)]

    def test_links(self):
        for link, wrong in (("there.md", 0), ("there.md#one-heading-and-code", 0), ("../tools/lint.sh", 0),
                            ("https://example.org/x", 0), ("#here", 0), ("gone.md", 1), ("there.md#two", 1),
                            ("#gone", 1)):
            self.assertEqual(self.found(f"# Here\n[words]({link})"), [2] * wrong, link)

    def test_tests(self):
        for name, wrong in (("Suite.HoldsWhatItSays", 0), (".GoesOnAfterIt", 0), ("Suite.GoesOnAfterIt", 1),
                            ("Suite.HoldsWhat", 1), (".HoldsNothing", 1), ("Suite.*", 0), ("MarkerArray.Xy", 0)):
            self.assertEqual(self.found(f"seen by `{name}`"), [1] * wrong, name)

    def test_files(self):
        for name, wrong in (("tools/lint.sh", 0), ("tools/gone.sh", 1), ("src/MODULE", 0), ("there/x", 0),
                            ("tools/lint.sh --fix", 0)):
            self.assertEqual(self.found(f"see `{name}`"), [1] * wrong, name)

    def test_blocks_of_code_are_not_read_but_counted(self):
        self.assertEqual(self.found("```\n[a](gone.md)\n```\n[b](gone.md)\n"), [4])

    def test_decisions_have_their_numbers(self):
        (self.root / "docs/0027-x.md").write_text("")
        self.assertEqual(self.found("[decision 27](0027-x.md)"), [])
        self.assertEqual(self.found("[decision 26](0027-x.md), [decision 27](0027-x.md)"), [1])

    def test_text_is_not_swallowed_by_a_table(self):
        self.assertEqual(self.found("| a |\n|---|\n| b |\n\ntext"), [])
        self.assertEqual(self.found("| a |\n|---|\n| b |\ntext"), [4])

    def test_headings_and_sources(self):
        self.assertEqual(anchors("# A b\n## C-d: e's `f_g`\n```\n# no\n```\n"), {"a-b", "c-d-es-f_g"})
        self.assertEqual(tests_of("TEST(One, Two) {\nTEST_F(Three,\n       Four) {\nTEST_P(Five, Six) {"),
                         {("One", "Two"), ("Three", "Four"), ("Five", "Six")})


if __name__ == "__main__":
    unittest.main()
