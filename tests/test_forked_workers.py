"""Processes that run tests tell of every file that cannot be loaded."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
TRIES_TWICE = """
import sys
import pytest
from tests.support.forked_workers import collect

collect(sys.argv[1:])
sys.exit(pytest.main(["-q", "-n0", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


def test_a_file_that_cannot_be_loaded_is_an_error_in_the_forks_too(tmp_path):
    (tmp_path / "test_broken.py").write_text("import no_such_module\n\n\ndef test_nothing():\n    pass\n")
    (tmp_path / "test_whole.py").write_text("def test_nothing():\n    pass\n")
    command = [sys.executable, "-c", TRIES_TWICE, "--import-mode=importlib", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 2, done.stdout
    assert "no_such_module" in done.stdout
