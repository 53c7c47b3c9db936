"""What the documents point to exists: files, make targets, commands."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted(
    path
    for path in ROOT.rglob("*.md")
    if not {".venv", "build", "node_modules"} & set(path.relative_to(ROOT).parts)
    and not path.relative_to(ROOT).parts[0].startswith(".")
)
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)")
COMMAND = re.compile(r"(?:`|^ {4}\$? ?)(?:\S*/)?(ribbonhost|ribbonhil) ([a-z][a-z-]+)", re.MULTILINE)
TARGET = re.compile(r"`make ([a-z]+)|^    make ([a-z]+)", re.MULTILINE)


def text_of(document: Path) -> str:
    return document.read_text(encoding="utf-8")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_lead_to_files(document: Path) -> None:
    missing = [link for link in LINK.findall(text_of(document)) if not (document.parent / link).exists()]
    assert missing == []


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    named = {name for document in DOCUMENTS for pair in TARGET.findall(text_of(document)) for name in pair}
    missing = [name for name in sorted(named - {""}) if not re.search(rf"^{name}:", makefile, re.MULTILINE)]
    assert missing == []


@pytest.mark.parametrize("program", ["ribbonhost", "ribbonhil"])
def test_commands_exist(program: str) -> None:
    usage = subprocess.run(
        [sys.executable, "-c", f"from {program}.cli import main; main()", "--help"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    known = set(re.findall(r"^\s+([a-z][a-z-]+)  ", usage.split("Commands:")[1], re.MULTILINE))
    named = {
        command
        for document in DOCUMENTS
        for tool, command in COMMAND.findall(text_of(document))
        if tool == program
    }
    assert named
    assert named <= known, f"known: {sorted(known)}"
