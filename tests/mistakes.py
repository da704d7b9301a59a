"""How every command of the project reports a user's mistake."""

from __future__ import annotations


def costs_one_line_and_no_earlier_result(command, folder, capsys, words):
    """``command()`` fails with one line on stderr that contains ``words`` and leaves ``folder`` unchanged."""
    (folder / "summary.json").write_text("earlier")
    assert command() == 2
    output = capsys.readouterr()
    assert output.out == ""
    (line,) = output.err.splitlines()
    assert line.startswith("error: ")
    assert words in line
    assert {path.name: path.read_text() for path in folder.iterdir()} == {"summary.json": "earlier"}
