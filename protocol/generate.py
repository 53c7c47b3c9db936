"""Turns schema.toml into the C header, the Python codec and the packet tables of PROTOCOL.md.

python protocol/generate.py            writes the files that differ
python protocol/generate.py --check    only says which differ: exit status 1 if any does
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from generator import c, markdown, python
from generator.errors import SchemaError
from generator.read import load
from generator.schema import Schema

ROOT = Path(__file__).resolve().parent.parent


def outputs(schema: Schema, root: Path) -> dict[Path, str]:
    """Every generated file and what it should hold."""
    prose = root / "protocol/PROTOCOL.md"
    return {
        root / "firmware/src/wire.h": c.emit(schema),
        root / "host/ribbonhost/wire.py": python.emit(schema),
        prose: markdown.emit(schema, prose.read_text(encoding="utf-8")),
    }


def main(arguments: list[str] | None = None) -> int:
    """Returns the exit status: 0, or 1 if the schema is wrong or --check found a difference."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="write nothing, exit 1 if a file differs")
    parser.add_argument("--root", type=Path, default=ROOT, help="the working tree (default: this one)")
    options = parser.parse_args(arguments)
    try:
        schema = load((options.root / "protocol/schema.toml").read_text(encoding="utf-8"))
        files = outputs(schema, options.root)
    except (SchemaError, OSError) as error:
        print(f"generate.py: {error}", file=sys.stderr)
        return 1
    differing = {
        p: text for p, text in files.items() if not p.exists() or p.read_text(encoding="utf-8") != text
    }
    for path, text in differing.items():
        if options.check:
            name = path.relative_to(options.root)
            print(
                f"{name} is not what protocol/schema.toml says: run python protocol/generate.py.",
                file=sys.stderr,
            )
        else:
            path.write_text(text, encoding="utf-8", newline="\n")
            print(f"wrote {path.relative_to(options.root)}")
    return 1 if options.check and differing else 0


if __name__ == "__main__":
    sys.exit(main())
