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

    def test_names_of_the_code(self):
        for name, line in (
            ("src/run/a.h", "ToldOutput output;"),
            ("apps/a.cpp", "loop.ask_for_force();"),
            ("include/palpate/a.h", "struct ViewWishes {"),
            ("web/src/a.ts", "const wishes = {};"),
            ("src/contact/a.cuh", "PlaceState* states;"),
            ("src/a.cu", "constexpr int kMostBytes = 4;"),
            ("eval/a.cpp", "double least_slope = 0;"),
            ("src/a.cpp", "if (is_wanted) filter(wanted);"),
            ("web/src/a.ts", "this.ask();"),
        ):
            self.assertEqual(len(list(check_text(line, name))), 1, line)
        for name, line in (
            ("docs/a.md", "ask_for_force"),  # sentences may say anything
            ("tests/a.cpp", "struct Asked {"),
            ("src/run/a.h", '"felt_x_m"'),  # columns of files keep their names
            ("src/run/a.h", "int num;  // as told_at says"),
            ("src/run/a.h", "task_for_all, basket"),
            ("src/run/a.h", "almost_all(at_most, utmost_)"),
            ("web/src/a.ts", "peaks.wanted_force_N"),  # of a file
        ):
            self.assertEqual(list(check_text(line, name)), [], line)

    def test_openings(self):
        for name, text in (
            ("src/a.h", "/// Whether it rests."),
            ("src/a.h", "int a;  ///< By how much, m."),
            ("src/a.cpp", "int b;\n// Of the page.\nint c;"),
            ("web/src/a.ts", "/**\n * What is shown.\n */"),
            ("python/a.py", 'def f():\n    """How far, m."""'),
            ("apps/a.cpp", 'Error{Errc::bad_input,\n  "what was read is none"}'),
        ):
            self.assertEqual(len(list(check_text(text, name))), 1, text)
        for name, text in (
            ("src/a.h", "/// Share of the pixel. What is left is free."),
            ("src/a.h", "/// The surface\n/// Of the page."),  # goes on
            ("docs/a.md", "// Whether it rests."),
            ("python/a.py", 'palette = "#Of"'),
        ):
            self.assertEqual(list(check_text(text, name)), [], text)

    def test_line_number(self):
        self.assertEqual([n for n, _, _ in check_text("a\nb FIX" + "ME\n")], [2])


if __name__ == "__main__":
    unittest.main()
