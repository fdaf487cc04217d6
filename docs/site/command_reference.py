"""The commands of ``polhode`` as a page, with the help that they print themselves."""

from collections.abc import Iterator

import click
import typer

from service.cli.commands import app

Words = tuple[str, ...]


def commands_page() -> str:
    """Return the page of all commands, in the order of their help."""
    lines = [
        "# Commands",
        "",
        "What `polhode COMMAND --help` prints. Files, exit codes and the other conventions: "
        "[the command line](../command-line.md).",
        "",
    ]
    for words, command in _commands(("polhode",), typer.main.get_command(app)):
        context = click.Context(command, info_name=" ".join(words))
        lines += [f"## {' '.join(words)}", "", _sentences(command.help or ""), "", "```"]
        lines += [command.get_usage(context), "```", "", *_parameters(command, context)]
        lines += _examples(command)
    return "\n".join(lines)


def _commands(words: Words, command: click.Command) -> Iterator[tuple[Words, click.Command]]:
    children = getattr(command, "commands", None)
    if children is None:
        yield words, command
        return
    for name, child in children.items():
        if not child.hidden:
            yield from _commands((*words, name), child)


def _examples(command: click.Command) -> Iterator[str]:
    examples = [line.strip() for line in (command.epilog or "").splitlines() if line.startswith("  ")]
    if examples:
        yield from ("```sh", *examples, "```", "")


def _parameters(command: click.Command, context: click.Context) -> Iterator[str]:
    rows = [record for one in command.get_params(context) if (record := _record(one, context))]
    if not rows:
        return
    yield from ("| | |", "| --- | --- |")
    for name, text in rows:
        yield f"| `{name}` | {_sentences(text).replace('|', '&#124;')} |"
    yield ""


def _record(parameter: click.Parameter, context: click.Context) -> tuple[str, str] | None:
    if isinstance(parameter, click.Argument):
        return parameter.make_metavar(context), getattr(parameter, "help", "") or ""
    record = parameter.get_help_record(context)
    return (record[0].replace("|", "/"), record[1]) if record else None


def _sentences(text: str) -> str:
    return " ".join(text.replace("\b", "").split())
