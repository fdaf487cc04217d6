"""The containers' files say only what there is: commands, options, settings, files."""

import os
import re
import shlex
from pathlib import Path

import pytest
import typer
import yaml

from service.cli.commands import app
from service.settings import Settings
from tests.container import images

TOP = Path(__file__).parents[2]
DOCKER = TOP / "docker"
COMPOSE = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))
DOCKERFILE = (DOCKER / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
OURS = {name: service for name, service in COMPOSE["services"].items() if "build" in service}
PLACEHOLDERS = {
    "N": "1",
    "ROLE": "read",
    "SPAN": "30d",
    "S": "1",
    "T": "0",
    "F": "json",
    "solutions|jobs|sweeps": "jobs",
}
FENCED = re.compile(r"```sh\n(.*?)```", re.DOTALL)


def environment_file(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    return dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))


EXAMPLE = environment_file(DOCKER / "env.example")


def parse(arguments):
    """Let the command line read the arguments as far as it does before it does anything."""
    command, names = typer.main.get_command(app), []
    while hasattr(command, "commands"):
        name, *arguments = arguments
        assert name in command.commands, f"polhode {' '.join([*names, name])}"
        command, names = command.commands[name], [*names, name]
    command.make_context(" ".join(names), list(arguments))


def interpolated(text, given):
    """Return a value as Compose makes it from the environment."""

    def value(match):
        name, _, rest = match[1].partition(":")
        found = given.get(name, "")
        if not found:
            assert rest.startswith(("-", "?")), f"{name} has no default"
            return "" if rest.startswith("?") else rest[1:]
        return found

    return re.sub(r"\$\{([^}]*)\}", value, str(text))


def seconds(span):
    number, unit = re.fullmatch(r"(\d+)(s|m)", span).groups()
    return int(number) * {"s": 1, "m": 60}[unit]


def settings_of(service, monkeypatch, **given):
    """Return the settings that a container would have."""
    for name in os.environ:
        if name.startswith("POLHODE_"):
            monkeypatch.delenv(name)
    for name, value in {**EXAMPLE, **service["environment"]}.items():
        monkeypatch.setenv(name, interpolated(value, {**EXAMPLE, **given}))
    return Settings()


@pytest.mark.parametrize("name", OURS)
def test_every_command_is_one_of_ours_with_options_it_has(name):
    parse(OURS[name]["command"])


@pytest.mark.parametrize("name", OURS)
def test_every_container_has_settings_that_are_accepted(name, monkeypatch):
    settings = settings_of(OURS[name], monkeypatch)
    assert settings.engine == "postgres"
    assert settings.database_url.startswith("postgresql+psycopg://")
    assert ":" not in settings.database_url.partition("@")[0].partition("://")[2], "no password in the URL"


def variables(text):
    return set(re.findall(r"\bPOLHODE_([A-Z_]+[A-Z])", text))


@pytest.mark.parametrize("file", ["docker/Dockerfile", "docker/compose.yaml", "docker/env.example"])
def test_every_variable_is_a_setting(file):
    known = {name.upper() for name in Settings.model_fields}
    assert variables((TOP / file).read_text(encoding="utf-8")) <= known


def test_the_operations_page_names_every_setting_and_no_other():
    known = {name.upper() for name in Settings.model_fields}
    assert variables((TOP / "docs" / "operations.md").read_text(encoding="utf-8")) == known


def test_the_operations_page_tells_the_true_defaults():
    """Where a default is no number or text the row says in words what it means."""
    page = (TOP / "docs" / "operations.md").read_text(encoding="utf-8")
    told = {}
    for line in page.splitlines():
        if line.startswith("| `POLHODE_"):
            names, defaults = line.split("|")[1:3]
            told |= dict(
                zip(re.findall(r"POLHODE_(\w+)", names), re.findall(r"`([^`]+)`", defaults), strict=False)
            )
    known = {name.upper(): field.default for name, field in Settings.model_fields.items()}
    in_words = {name for name, default in known.items() if default in (None, "")}
    assert set(told) == set(known) - in_words
    assert all(str(known[name]).removesuffix(".0") == value for name, value in told.items())


@pytest.mark.parametrize("page", ["docs/command-line.md", "docs/operations.md", "docs/keys.md"])
def test_commands_in_the_documentation_are_accepted(page, tmp_path):
    text = (TOP / page).read_text(encoding="utf-8")
    lines = [line.partition("#")[0].strip() for block in FENCED.findall(text) for line in block.splitlines()]
    commands = [line.partition("polhode ")[2] for line in lines if re.match(r"([A-Z_]+=\S+ )*polhode ", line)]
    commands += [line.partition("run --rm api ")[2] for line in lines if "run --rm api " in line]
    assert commands
    for command in commands:
        # Synopses have brackets around options, and words in capitals for what is to be filled in.
        words = shlex.split(re.sub(r"[][]", "", command.partition(" | ")[0]))
        parse([PLACEHOLDERS.get(word, word) for word in words if word != "…"])


def test_the_first_steps_are_commands_that_there_are():
    head = (DOCKER / "compose.yaml").read_text(encoding="utf-8").partition("name: polhode")[0]
    (command,) = re.findall(r"run --rm api (.*)", head)
    parse(shlex.split(command))
    assert re.findall(r"cp (\S+) (\S+)", head) == [("docker/env.example", "docker/.env")]


def test_every_file_that_is_referred_to_exists():
    for service in OURS.values():
        context = (DOCKER / service["build"]["context"]).resolve()
        assert context == TOP
        assert (context / service["build"]["dockerfile"]).is_file()
        # Made by the reader from the example, and never committed.
        assert service["env_file"] == ".env"
    assert "/docker/.env" in (TOP / ".gitignore").read_text(encoding="utf-8").splitlines()


def test_everything_that_the_image_copies_exists_and_is_sent_to_the_builder():
    ignore = (DOCKER / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
    sent = {line[1:] for line in ignore if line.startswith("!")}
    copied = set()
    for line in re.findall(r"^COPY (?!--from)(.*)$", DOCKERFILE, re.MULTILINE):
        *sources, _ = line.split()
        copied |= set(sources)
    assert copied == sent
    assert all((TOP / source).exists() for source in copied)


def test_the_image_runs_as_nobody_in_particular_and_starts_the_command_line():
    assert re.findall(r"^USER (.*)$", DOCKERFILE, re.MULTILINE) == ["polhode"]
    assert re.findall(r"^ENTRYPOINT (.*)$", DOCKERFILE, re.MULTILINE) == ['["polhode"]']
    (command,) = re.findall(r"^CMD (.*)$", DOCKERFILE, re.MULTILINE)
    parse(yaml.safe_load(command))


def test_the_health_of_the_api_is_asked_where_it_listens_without_a_key():
    (asked,) = re.findall(r"http://127\.0\.0\.1:(\d+)(/\w+)", DOCKERFILE)
    arguments = OURS["api"]["command"]
    assert asked == (arguments[arguments.index("--port") + 1], "/readyz")
    assert all(OURS[name]["healthcheck"] == {"disable": True} for name in ("worker", "migrate"))


def test_containers_are_given_the_time_that_their_processes_take_to_stop(monkeypatch):
    grace = settings_of(OURS["worker"], monkeypatch).grace_seconds
    assert seconds(OURS["worker"]["stop_grace_period"]) > grace
    assert seconds(OURS["api"]["stop_grace_period"]) > 3  # FINISH_REQUESTS_SECONDS of the service


def test_nothing_starts_before_the_tables_are_there():
    for name in ("api", "worker"):
        assert OURS[name]["depends_on"] == {"migrate": {"condition": "service_completed_successfully"}}
    assert OURS["migrate"]["depends_on"] == {"postgres": {"condition": "service_healthy"}}
    assert OURS["migrate"]["restart"] == "no"
    assert "healthcheck" in COMPOSE["services"]["postgres"]


def test_no_secret_has_a_default():
    assert EXAMPLE["POSTGRES_PASSWORD"] == ""
    text = (DOCKER / "compose.yaml").read_text(encoding="utf-8")
    assert set(re.findall(r"\$\{POSTGRES_PASSWORD(.)", text)) == {":"}
    assert set(re.findall(r"\$\{POSTGRES_PASSWORD:(.)", text)) == {"?"}


def test_the_client_programs_are_of_the_servers_version():
    (client,) = re.findall(r"postgresql-client-(\d+)", DOCKERFILE)
    (server,) = re.findall(r"^postgres:(\d+)", COMPOSE["services"]["postgres"]["image"])
    assert client == server


def test_every_volume_that_is_used_is_declared():
    used = {
        v.partition(":")[0] for service in COMPOSE["services"].values() for v in service.get("volumes", [])
    }
    assert used == set(COMPOSE["volumes"])


def test_the_images_that_are_built_without_docker_are_those_of_the_files():
    bases = set(re.findall(r"^FROM (\S+)", DOCKERFILE, re.MULTILINE))
    assert {images.BASE.removeprefix("docker.io/library/")} == bases
    assert images.POSTGRES.removeprefix("docker.io/library/") == COMPOSE["services"]["postgres"]["image"]
    assert images.POLHODE.removeprefix("localhost/") == OURS["api"]["image"]
