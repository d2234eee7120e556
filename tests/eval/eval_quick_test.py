"""Makes all figures in their quick form with the real program, and looks at what comes out.

Usage: eval_quick_test.py PATH_OF_PALPATE DATA_FOLDER PATH_OF_PALPATE_EVAL"""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "tools"))
import check_evaluation

PALPATE, DATA, PALPATE_EVAL = sys.argv[1:4]
HERE = os.path.dirname(os.path.abspath(__file__))
SOURCE = os.path.join(HERE, "..", "..")
TEXTS = ["docs", "README.md"]
VERDICTS = {"thesis": {"agrees", "differs", "contradicts", "not comparable", "not measured"},
            "ours": {"better", "even", "worse", "not measured"},
            "docs": {"holds", "holds in part", "fails", "not measured"}}


def palpate_eval(*arguments):
    return subprocess.run([PALPATE_EVAL, *arguments], capture_output=True, text=True,
                          timeout=3000)


def wanted_rows():
    return check_evaluation.wanted_rows(check_evaluation.ROWS.read_text())


class QuickEvaluation(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="palpate-eval-")
        cls.report = os.path.join(cls.folder, "report")
        cls.texts = os.path.join(cls.folder, "texts")
        shutil.copytree(os.path.join(SOURCE, "docs"), os.path.join(cls.texts, "docs"))
        shutil.copy(os.path.join(SOURCE, "README.md"), cls.texts)
        arguments = ["--quick", "-o", cls.report, "--json", "--commit", "0123abc",
                     "--golden", check_evaluation.hash_of("bits of a program\n"), "--write-docs", *(os.path.join(cls.texts, name) for name in TEXTS)]
        if os.path.isdir(DATA):
            arguments += ["--data", DATA]
        cls.result = palpate_eval(*arguments)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def figures(self):
        return json.loads(self.result.stdout)["figures"]

    def data_of(self, figure):
        stem = re.sub(r"[^A-Za-z0-9.-]", "_", figure["id"])
        with open(os.path.join(self.report, "data", stem + ".json")) as file:
            return json.load(file)

    def test_no_figure_fails(self):
        self.assertEqual(self.result.returncode, 0, self.result.stderr)

    def test_every_row_has_a_verdict_or_is_a_drawing(self):
        listed = json.loads(palpate_eval("--list", "--json").stdout)
        covered = set()
        made = {figure["id"]: figure for figure in self.figures()}
        for figure in listed:
            claims = made.get(figure["id"], {"claims": []})["claims"]
            is_drawn = figure["section"] == "Drawings"
            if (claims or is_drawn) and all(claim["verdict"] in VERDICTS[claim["source"]]
                                            for claim in claims):
                covered |= set(figure["thesis_figures"]) | {figure["id"]}
        self.assertEqual([row for row in wanted_rows() if row not in covered], [])

    def test_the_page_has_every_row_and_its_arithmetic(self):
        with open(os.path.join(self.texts, "docs", "evaluation.md")) as file:
            page = file.read()
        rows = check_evaluation.ROWS.read_text()
        self.assertEqual(list(check_evaluation.problems(page, "bits of a program\n", rows)), [])
        self.assertNotEqual(check_evaluation.marked(page, "other bits\n"), page)

    def test_one_run_has_one_verdict(self):
        """Nothing is counted twice: no two claims of a kind come from the same measurement."""
        measured = {}
        for figure in self.figures():
            for claim in figure["claims"]:
                # Words like "never", whole percents, numbers of two digits, and ratios of times are the same by chance.
                numbers = re.sub(r"[0-9.]+ times as long", "", claim["measured"])
                if re.search(r"[1-9][0-9]*\.[0-9]{2}|0\.0*[1-9][0-9]{2}", numbers):
                    key = (claim["source"], claim["measured"])
                    measured.setdefault(key, []).append((figure["id"], claim["claim"]))
        self.assertEqual([where for where in measured.values() if len(where) > 1], [])

    def test_hardware_of_another_time_is_not_compared(self):
        claims = [claim for figure in self.figures() for claim in figure["claims"]
                  if "GTX" in claim["claim"] + claim["measured"]]
        self.assertGreater(len(claims), 1)
        self.assertEqual({claim["verdict"] for claim in claims} - {"not comparable", "not measured"},
                         set())

    def test_claims_are_sentences(self):
        for figure in self.figures():
            for claim in figure["claims"]:
                for text in (claim["claim"], claim["measured"]):
                    self.assertGreater(len(text), 10, figure["id"])
                    self.assertNotRegex(text, r"\bnan\b|\binf\b", figure["id"])

    def test_numbers_are_finite_and_unique(self):
        for figure in self.figures():
            numbers = self.data_of(figure)["numbers"]
            keys = [number["key"] for number in numbers]
            self.assertEqual(len(keys), len(set(keys)), figure["id"])
            for number in numbers:
                self.assertTrue(number["value"] is not None and math.isfinite(number["value"]),
                                (figure["id"], number))

    def test_plots_are_whole(self):
        for figure in self.figures():
            data = self.data_of(figure)
            for plot in data["plots"]:
                where = (figure["id"], plot["title"])
                self.assertTrue(plot["caption"] and plot["x_label"] and plot["y_label"], where)
                self.assertTrue(plot["curves"], where)
                for curve in plot["curves"]:
                    self.assertEqual(len(curve["x"]), len(curve["y"]), where)
            for table in data["tables"]:
                for row in table["rows"]:
                    self.assertEqual(len(row), len(table["columns"]), (figure["id"], row))

    def test_the_page_stands_alone(self):
        path = os.path.join(self.report, "index.html")
        self.assertLess(os.path.getsize(path), 15e6)
        with open(path) as file:
            page = file.read()
        self.assertNotRegex(page, r"(src|href)=['\"]?(https?:|//)|@import")
        data = json.loads(page.split('id="data">')[1].split("</script>")[0])
        self.assertIn("commit 0123abc", data["form"])
        self.assertEqual([figure["id"] for figure in data["figures"] if figure["stored"]],
                         [figure["id"] for figure in self.figures()])
        with open(os.path.join(self.texts, "docs", "evaluation.md")) as file:
            docs = file.read()
        for figure in self.figures():
            if figure["claims"]:
                self.assertTrue(f"| {figure['id']} |" in docs.replace("\\", ""), figure["id"])

    def test_guides_quote_tables_that_there_are(self):
        """Each quoted table, in the form that it has in the guide: only the numbers change."""
        num_quoted = 0
        for folder, _, names in os.walk(self.texts):
            for name in (name for name in names if name.endswith(".md")):
                relative = os.path.relpath(os.path.join(folder, name), self.texts)
                ours, theirs = (self.quoted(os.path.join(root, relative))
                                for root in (SOURCE, self.texts))
                self.assertEqual(ours.keys(), theirs.keys(), relative)
                for quote in theirs:
                    self.assertEqual(ours[quote][:2], theirs[quote][:2], (relative, quote))
                    self.assertGreater(len(theirs[quote]), 2, (relative, quote))
                num_quoted += len(theirs)
        self.assertGreater(num_quoted, 5)

    @staticmethod
    def quoted(path):
        """Lines of the table after each mark of a text."""
        with open(path) as file:
            blocks = re.findall(r"<!-- eval ([^\n]*) -->\n(.*?)<!-- /eval -->", file.read(), re.DOTALL)
        return {mark: [line for line in text.splitlines() if line.startswith("|")]
                for mark, text in blocks}

    def test_a_second_run_makes_nothing(self):
        arguments = ["--quick", "-o", self.report, "--json", "--commit", "0123abc"]
        if os.path.isdir(DATA):
            arguments += ["--data", DATA]
        again = json.loads(palpate_eval(*arguments).stdout)
        self.assertEqual(again["made"], 0)
        self.assertEqual(again["kept"], len(self.figures()))


class Errors(unittest.TestCase):

    def check(self, arguments, status, *words):
        run = palpate_eval(*arguments)
        self.assertEqual(run.returncode, status, run.stderr)
        self.assertEqual(run.stderr.count("\n"), 1, run.stderr)
        for word in words:
            self.assertIn(word, run.stderr)

    def test_wrong_usage(self):
        self.check(["5.99", "-o", "x"], 2, "'5.99'", "near are ", "5.9")
        self.check(["spede", "-o", "x"], 2, "'spede'", "speed")
        self.check([], 2, "-o REPORT")
        self.check(["-o", "x", "--gpu", "no-such.csv"], 2, "no-such.csv")
        self.check(["-o", "x", "--data", "no-such-folder"], 2, "no-such-folder")
        self.check(["-o", "x", "--write-docs", "no-such-folder"], 2, "no-such-folder")
        self.assertFalse(os.path.exists("x"))

    def test_a_folder_of_other_things(self):
        with tempfile.TemporaryDirectory() as folder:
            with open(os.path.join(folder, "thesis.txt"), "w") as file:
                file.write("mine")
            self.check(["3.1", "-o", folder], 1, "thesis.txt")
            self.assertEqual(os.listdir(folder), ["thesis.txt"])

    def test_palpate_hands_its_words_on(self):
        words = ["--list", "--json", "drawings"]
        run = subprocess.run([PALPATE, "eval", *words], capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stdout), (0, palpate_eval(*words).stdout))
        run = subprocess.run([PALPATE, "eval", "--help"], capture_output=True, text=True)
        self.assertIn("--write-docs", run.stdout)
        run = subprocess.run([PALPATE, "eval", "5.99", "-o", "x"], capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stderr.count("\n")), (2, 1), run.stderr)
        with tempfile.TemporaryDirectory() as folder:
            alone = os.path.join(folder, "palpate")
            shutil.copy(PALPATE, alone)
            run = subprocess.run([alone, "eval", *words], capture_output=True, text=True)
            self.assertEqual((run.returncode, run.stderr.count("\n")), (1, 1), run.stderr)
            self.assertIn("make eval", run.stderr)

    def test_list(self):
        run = palpate_eval("--list", "drawings")
        self.assertEqual(run.returncode, 0)
        self.assertIn("4.5-4.7", run.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
