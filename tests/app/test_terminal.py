from rich.progress import Progress
from rich.table import Table

from armguard.app.terminal import describe_column, make_console


def test_text_from_data_is_printed_as_it_is(capsys):
    table = Table("id [bold]")
    table.add_row("hand [statics] [/] [red]x")
    make_console().print("premise: [statics] of the cell [/nothing]", table)
    out = capsys.readouterr().out
    for text in ("[statics] of the cell [/nothing]", "id [bold]", "hand [statics] [/] [red]x"):
        assert text in out


def test_a_progress_bar_shows_brackets_too(capsys):
    with Progress(describe_column(), console=make_console()) as progress:
        progress.add_task("link [statics]")
    assert "link [statics]" in capsys.readouterr().out
