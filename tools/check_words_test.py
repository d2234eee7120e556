"""The word checker itself. The refused words are put together here so that this file passes."""

import unittest

from check_words import check_text


class CheckWordsTest(unittest.TestCase):
    def test_refused(self):
        for text in (
            "data = '/" + "home/someone/data'",
            "cd /" + "work/main",
            "pip install -i https://py" + "pi.org/simple",
            "// TO" + "DO: later",
        ):
            self.assertEqual(len(list(check_text(text))), 1, text)

    def test_passes(self):
        for text in (
            "../shared/data",
            "build/work/main",
            "/usr/share/common-licenses/Apache-2.0",
            "${root}/home/x",
            "https://example.org/home/page",
            "a hackathon",
        ):
            self.assertEqual(list(check_text(text)), [], text)

    def test_line_number(self):
        self.assertEqual([n for n, _, _ in check_text("a\nb FIX" + "ME\n")], [2])


if __name__ == "__main__":
    unittest.main()
