"""What the documents for users tell to type can be typed: options are those that there are, examples run."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from ribbonhost.cli.app import build_app
from typer.main import get_command

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMAND = [sys.executable, "-c", "from ribbonhost.cli import main; main()"]


def blocks(text: str) -> Iterator[str]:
    """Lines of code: indented, or fenced without a language of their own."""
    fenced = ""
    for line in text.splitlines():
        if line.startswith("```"):
            fenced = "" if fenced else line
        elif not fenced and line.startswith("    "):
            yield line.strip()


def typed() -> list[tuple[str, str]]:
    """(document, command) of all commands of ribbonhost in the documents."""
    found = []
    for path in DOCUMENTS:
        for line in blocks(path.read_text()):
            line = line.removeprefix("$ ").removeprefix(".venv/bin/")
            if line.startswith("ribbonhost ") and " = " not in line:
                found.append((path.name, line))
    return found


def options_of(command: object) -> set[str]:
    return {name for parameter in command.params for name in parameter.opts + parameter.secondary_opts}  # type: ignore[attr-defined]


def test_each_command_and_option_in_the_documents_exists() -> None:
    root = get_command(build_app())
    seen = set()
    assert len(typed()) > 30
    for document, line in typed():
        words = shlex.split(line, comments=True)[1:]
        words = words[: words.index("|")] if "|" in words else words
        command = root
        while words and words[0] in getattr(command, "commands", {}):
            seen.add(words[0])
            command = command.commands[words.pop(0)]  # type: ignore[attr-defined]
        assert command is not root or words[0].startswith("-"), (
            f"{document}: {line}: there is no such command"
        )
        for word in words:
            if word.startswith("-") and not word.lstrip("-").replace(".", "").isdigit():
                name = word.partition("=")[0]
                assert name in options_of(command) | {"--help", "-h"}, f"{document}: {line}: no {name}"
    assert seen >= set(root.commands) - {"bench"}  # type: ignore[attr-defined]


def test_each_command_has_an_example_that_can_be_typed() -> None:
    root = get_command(build_app())

    def leaves(command: object, path: str) -> Iterator[tuple[str, object]]:
        for name, sub in getattr(command, "commands", {}).items():
            yield from leaves(sub, f"{path} {name}")
        if not hasattr(command, "commands"):
            yield path, command

    for path, command in leaves(root, "ribbonhost"):
        epilog = command.epilog or ""  # type: ignore[attr-defined]
        assert epilog.startswith(f"Example: {path}"), f"`{path} --help` has no example"
        words = shlex.split(epilog.removeprefix(f"Example: {path}"))
        assert {w for w in words if w.startswith("--")} <= options_of(command), epilog


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("typed")


def run(folder: Path, *arguments: str) -> str:
    done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, f"{arguments}: {done.stderr}"
    return done.stdout


def ribbonhost(folder: Path, line: str) -> str:
    return run(folder, *COMMAND, *shlex.split(line)[1:])


def python_of(document: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / document).read_text(), re.DOTALL)


def test_the_way_without_a_ribbon_can_be_gone_to_the_end(folder: Path) -> None:
    text = (ROOT / "docs/first-ribbon.md").read_text()
    lines = [
        line for line in blocks(text[text.index("## Without a ribbon") :]) if line.startswith("ribbonhost")
    ]
    assert len(lines) == 3
    for line in lines:
        ribbonhost(folder, line)
    (analysis,) = python_of("exporting.md")
    assert re.match(
        r"\d+ frames; the quickest node moves at \d\.\d\d m/s", run(folder, sys.executable, "-c", analysis)
    )


def test_the_listener_in_the_document_listens(folder: Path) -> None:
    (listener,) = python_of("live-out.md")
    stream = subprocess.Popen(
        [
            *COMMAND,
            *shlex.split("stream --emulate wing --ribbons 2 --seconds 2 --json --out tcp://127.0.0.1:0"),
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert stream.stdout
    for line in stream.stdout:
        if found := re.search(r"listen at tcp://127\.0\.0\.1:(\d+)", json.loads(line).get("note", "")):
            break
    heard = run(folder, sys.executable, "-c", listener.replace("8766", found[1]))
    stream.communicate(timeout=30)
    assert heard.splitlines()[0] == "reference, at 0 m, at 0.15 m"
    assert re.fullmatch(r"frame \d+: the last node of the last ribbon is at \[.+\]", heard.splitlines()[-1])
    assert len(heard.splitlines()) > 50


def test_documents_name_files_that_there_are() -> None:
    for path in DOCUMENTS:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", path.read_text()):
            assert (path.parent / target).exists(), f"{path.name} points to {target}"


def all_commands(command: object, name: str = "ribbonhost") -> Iterator[tuple[str, object]]:
    yield name, command
    for word, part in getattr(command, "commands", {}).items():
        yield from all_commands(part, f"{name} {word}")


def test_each_argument_and_option_says_what_it_is_for() -> None:
    silent = [
        f"{name} {parameter.name}"
        for name, command in all_commands(get_command(build_app()))
        for parameter in command.params  # type: ignore[attr-defined]
        if not parameter.help
    ]
    assert silent == []
