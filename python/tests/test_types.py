"""The stubs: mypy --strict over a program that uses everything, and stubtest against the module."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mypy")
HERE = Path(__file__).parent


def run(*command, cwd):
    result = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True,
                            cwd=cwd, env={**os.environ, "MYPYPATH": ""})
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_program_that_uses_the_types(tmp_path):
    run("mypy", "--strict", str(HERE / "typed_program.py"), cwd=tmp_path)


def test_a_wrong_program_is_refused(tmp_path):
    (tmp_path / "wrong.py").write_text(
        "import palpate\n"
        "tool: int = palpate.load_tool('a.palp')\n"
        "palpate.Sensor(palpate.Camera(8, 8, 1.0, 1.0, 1.0, 1.0), place=3)\n")
    result = subprocess.run([sys.executable, "-m", "mypy", "--strict", "wrong.py"],
                            capture_output=True, text=True, cwd=tmp_path)
    assert result.returncode != 0
    assert "wrong.py:2" in result.stdout and "wrong.py:3" in result.stdout


def test_the_package_itself(tmp_path):
    modules = [word for name in ("_run", "_types", "_program", "_query", "plot", "poses", "ray", "sinks") for word in ("-m", f"palpate.{name}")]
    run("mypy", "--strict", "--ignore-missing-imports", *modules, cwd=tmp_path)


#: Messages of stubtest about every nanobind module, whose functions and classes have their own types.
OF_NANOBIND = (
    "is not a function",
    "is a disjoint base at runtime",
    "metaclass differs",
    "__nb_enum__ is not present in stub",
    'does not have *args parameter "args"',  # of classes that only functions make
)


def test_stubtest(tmp_path):
    """Every name of the module is in the stub, and every name of the stub in the module."""
    result = subprocess.run([sys.executable, "-m", "mypy.stubtest", "palpate._core", "--concise"],
                            capture_output=True, text=True, cwd=tmp_path)
    lines = [line for line in (result.stdout + result.stderr).splitlines() if line.startswith("palpate._core")]
    assert any("palpate._core.pack is not a function" in line for line in lines), result.stdout + result.stderr
    assert [line for line in lines if not any(known in line for known in OF_NANOBIND)] == []
