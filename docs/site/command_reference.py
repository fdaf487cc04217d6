"""The commands of ``polhode`` as a page, with the help that they print themselves."""

from collections.abc import Iterator

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from service.cli.commands import app

Command = TyperCommand | TyperGroup
Parameter = TyperArgument | TyperOption
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
    for words, command in _commands(("polhode",), _checked(typer.main.get_command(app))):
        context = typer.Context(command, info_name=" ".join(words))
        lines += [f"## {' '.join(words)}", "", _sentences(command.help or ""), "", "```"]
        lines += [command.get_usage(context), "```", "", *_parameters(command, context)]
        lines += _examples(command)
    return "\n".join(lines)


def _commands(words: Words, command: Command) -> Iterator[tuple[Words, Command]]:
    if not isinstance(command, TyperGroup):
        yield words, command
        return
    for name, child in command.commands.items():
        if not child.hidden:
            yield from _commands((*words, name), _checked(child))


def _checked(command: object) -> Command:
    if not isinstance(command, Command):
        raise TypeError(f"{command} is no command")
    return command


def _examples(command: Command) -> Iterator[str]:
    examples = [line.strip() for line in (command.epilog or "").splitlines() if line.startswith("  ")]
    if examples:
        yield from ("```sh", *examples, "```", "")


def _parameters(command: Command, context: typer.Context) -> Iterator[str]:
    parameters = [one for one in command.get_params(context) if isinstance(one, Parameter)]
    rows = [record for one in parameters if (record := _record(one, context))]
    if not rows:
        return
    yield from ("| | |", "| --- | --- |")
    for name, text in rows:
        yield f"| `{name}` | {_sentences(text).replace('|', '&#124;')} |"
    yield ""


def _record(parameter: Parameter, context: typer.Context) -> tuple[str, str] | None:
    record = parameter.get_help_record(context)
    return (record[0].replace("|", "/"), record[1]) if record else None


def _sentences(text: str) -> str:
    return " ".join(text.replace("\b", "").split())
