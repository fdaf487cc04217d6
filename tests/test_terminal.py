"""Documents, answers and files of commands: every fault is one line, and an exit code."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service import terminal
from service.cli import commands
from service.terminal import STANDARD_STREAM, FileFaultError, OutputFile, check_writable
from tests.support.commands import polhode

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "bobylev-steklov.json"
POLHODE = Path(sys.executable).with_name("polhode")
NOT_ROOT = pytest.mark.skipif(os.geteuid() == 0, reason="root may read and write everything")


def validate(*arguments):
    """Run ``polhode validate`` in this process: its exit code, and what it says on stderr."""
    result = CliRunner().invoke(commands.app, ["validate", *map(str, arguments)])
    if isinstance(result.exception, FileFaultError):
        return 1, f"{result.exception}\n"
    return result.exit_code, result.stderr


@pytest.fixture(params=["validate", "solve", "sweep"])
def read(request, capsys):
    """Run each of the commands that read a document."""

    def command(*arguments):
        if request.param == "validate":
            return validate(*arguments)
        code = polhode(request.param, *arguments)
        out, err = capsys.readouterr()
        assert out == ""
        return code, err

    return command


FAULTS = {
    "empty": (b"", "the file is empty; a JSON document is expected"),
    "blank": (b" \n\t", "the file is empty; a JSON document is expected"),
    "cut off": (b'{"body": ', "line 1, column 10: Expecting value"),
    "mark alone": (b"\xef\xbb\xbf{", "line 1, column 2: Expecting property name enclosed in double quotes"),
    "UTF-16": ('{"body": 1}'.encode("utf-16"), "byte 1 is not UTF-8"),
    "Latin-1": (b'{"\xe9": 1}', "byte 3 is not UTF-8"),
    "field twice": (b'{"body": {"A": 2, "A": 3}}', "the field 'A' is given twice in one object"),
    "no number": (b'{"A": NaN}', "NaN is not JSON; finite numbers are accepted"),
    "two documents": (b"{} {}", "line 1, column 4: Extra data"),
    "too deep": (b"[" * 100_000, "lists and objects too deep inside each other"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_no_document_is_refused_by_all_in_the_same_words(read, tmp_path, name):
    content, reason = FAULTS[name]
    file = tmp_path / "document.json"
    file.write_bytes(content)
    assert read(file) == (1, f"{file}: {reason}\n")


def test_a_file_that_cannot_be_read_is_refused(read, tmp_path):
    assert read(tmp_path / "no.json") == (1, f"{tmp_path / 'no.json'}: No such file or directory\n")
    assert read(tmp_path) == (1, f"{tmp_path}: Is a directory\n")
    assert read(tmp_path / ("n" * 300)) == (1, f"{tmp_path / ('n' * 300)}: File name too long\n")
    (tmp_path / "loop").symlink_to("loop")
    assert read(tmp_path / "loop") == (1, f"{tmp_path / 'loop'}: Too many levels of symbolic links\n")


@NOT_ROOT
def test_a_file_without_permission_is_refused(read, tmp_path):
    file = tmp_path / "mine.json"
    file.touch(mode=0)
    assert read(file) == (1, f"{file}: Permission denied\n")


def test_an_endless_file_is_refused(read, monkeypatch):
    monkeypatch.setattr(terminal, "MAX_DOCUMENT_BYTES", 1000)
    assert read("/dev/zero") == (1, "/dev/zero: too large; at most 1000 bytes are accepted\n")


def test_a_document_that_is_no_object_is_refused(read, tmp_path):
    file = tmp_path / "list.json"
    file.write_text("[1]", encoding="utf-8")
    code, said = read(file)
    assert code == 1
    assert said.startswith("/: an object is expected")


def test_a_byte_order_mark_is_accepted_by_all(tmp_path):
    # As over HTTP.
    file = tmp_path / "marked.json"
    file.write_bytes(b"\xef\xbb\xbf" + b'{"body": 1}')
    assert terminal.read_document(file) == {"body": 1}


def test_a_dash_reads_stdin(monkeypatch):
    stdin = io.TextIOWrapper(io.BytesIO(b'{"body": 1}'))
    monkeypatch.setattr(sys, "stdin", stdin)
    assert terminal.read_document(STANDARD_STREAM) == {"body": 1}
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(FileFaultError, match="stdin: it is closed"):
        terminal.read_document(STANDARD_STREAM)


OUTPUT_FAULTS = [
    ("missing/out.csv", "No such file or directory"),
    (".", "Is a directory"),
    ("file/out.csv", "Not a directory"),
]


@pytest.fixture
def no_computation(monkeypatch):
    """Fail if anything is computed."""

    def compute(*_):
        raise AssertionError("it has computed")

    monkeypatch.setattr("workers.cli.documents._compute", compute)
    monkeypatch.setattr("workers.cli.sweep.LocalPool", compute)


@pytest.mark.parametrize(("name", "reason"), OUTPUT_FAULTS)
def test_an_output_that_cannot_be_written_is_told_before_anything_is_computed(
    tmp_path, capsys, no_computation, name, reason
):
    (tmp_path / "file").touch()
    out = tmp_path / name
    assert polhode("solve", EXAMPLE, "--csv", out) == 1
    assert capsys.readouterr() == ("", f"{out}: {reason}\n")
    points = tmp_path / "points.csv"
    sweep = ROOT / "examples" / "sweep.json"
    if name == ".":
        points.mkdir()
        assert polhode("sweep", sweep, "--out", points) == 1
        assert capsys.readouterr() == ("", f"{points}: {reason}\n")
    else:
        assert polhode("sweep", sweep, "--out", out) == 1
        assert capsys.readouterr() == ("", f"{out}: {reason}\n")


@pytest.mark.parametrize(("command", "option"), [("solve", "--csv"), ("sweep", "--out")])
def test_one_stream_holds_one_answer(command, option, capsys, no_computation):
    assert polhode(command, EXAMPLE, "--json", option, "-") == 2
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert "stdout" in err


def test_looking_whether_a_file_can_be_written_leaves_it_as_it_is(tmp_path):
    old, new, pipe = tmp_path / "old", tmp_path / "new", tmp_path / "pipe"
    old.write_text("kept", encoding="utf-8")
    os.mkfifo(pipe)
    for path in (old, new, pipe, Path(os.devnull)):
        check_writable(path)
    assert old.read_text(encoding="utf-8") == "kept"
    assert not new.exists()


def test_a_file_that_is_written_replaces_the_old_one(tmp_path):
    file = tmp_path / "out"
    file.write_text("something longer", encoding="utf-8")
    with OutputFile(file) as output:
        assert output.write(b"new") == 3
    assert file.read_bytes() == b"new"


def test_a_full_disk_is_told():
    with OutputFile(Path("/dev/full")) as output, pytest.raises(FileFaultError) as told:
        output.write(b"content")
    assert str(told.value) == "/dev/full: No space left on device"


def test_samples_go_to_stdout_and_the_description_to_people(capfd):
    assert polhode("solve", EXAMPLE, "--csv", "-") == 0
    out, err = capfd.readouterr()
    assert out.startswith("t,p,q,r,g1,g2,g3\n0.0,")
    assert len(out.splitlines()) == 202
    assert err.startswith("method      quadrature\n")


@pytest.mark.parametrize("command", [["--version"], ["keys", "list", "--json"]])
def test_an_answer_that_nobody_can_have_is_one_line(command, tmp_path):
    read_end, write_end = os.pipe()
    os.close(read_end)
    environment = {**os.environ, "POLHODE_DATABASE_URL": f"sqlite:///{tmp_path / 'test.db'}"}
    full = os.open("/dev/full", os.O_WRONLY)
    for stdout, reason in ((write_end, "Broken pipe"), (full, "No space left on device")):
        ended = subprocess.run(
            [POLHODE, *command],
            stdout=stdout,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            check=False,
        )
        os.close(stdout)
        assert (ended.returncode, ended.stderr) == (1, f"stdout: {reason}\n")


def test_an_answer_shows_what_the_stream_cannot(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    terminal.answer("λ = 1, \udcff\n")
    assert stream.buffer.getvalue() == b"\\u03bb = 1, \\udcff\n"


def test_a_closed_stdout_is_told(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    for use in (lambda: terminal.answer("x"), lambda: check_writable(STANDARD_STREAM)):
        with pytest.raises(FileFaultError, match="stdout: it is closed"):
            use()


def test_the_version_is_told():
    result = CliRunner().invoke(commands.app, ["--version"])
    assert result.exit_code == 0
    assert result.stdout.startswith("polhode 0.")


def test_settings_that_cannot_be_are_one_line_on_every_command(monkeypatch, capsys):
    monkeypatch.setenv("POLHODE_JOB_SECONDS", "soon")
    for arguments in (["worker"], ["solve", EXAMPLE], ["sweep", EXAMPLE], ["doctor"], ["calibrate"]):
        assert polhode(*arguments) == 2
        out, err = capsys.readouterr()
        assert (out, len(err.splitlines())) == ("", 1)
        assert err.startswith("job_seconds: ")


def test_backups_name_the_file_that_is_wrong(tmp_path, sqlite_url):
    runner = CliRunner()
    folder = tmp_path / "folder"
    folder.mkdir()
    cases = {
        ("backup", str(tmp_path / "missing" / "a.backup")): "No such file or directory",
        ("backup", "--force", str(folder)): "it is a directory",
        ("restore", str(folder)): "it is a directory",
        ("restore", str(tmp_path / "no.backup")): "there is no such file",
    }
    for arguments, reason in cases.items():
        result = runner.invoke(commands.app, [*arguments, "--database-url", sqlite_url])
        assert result.exit_code == 1, result.output
        assert len(result.stderr.splitlines()) == 1
        assert arguments[-1] in result.stderr
        assert reason in result.stderr
    assert sorted(path.name for path in tmp_path.iterdir() if "part" in path.name) == []
