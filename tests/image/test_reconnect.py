"""The image restarts while a host streams: its ribbons are found again and set up again."""

import json
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from image.programs import built

RIBBONHOST = [sys.executable, "-c", "from ribbonhost.cli import main; main()"]
PORT = 7790


@contextmanager
def serving(folder: Path, image: Path) -> Iterator[list[str]]:
    """`ribbonhil serve` with an image; the ports of its ribbons. It ends as power that is cut."""
    options = ["--ribbons", "2", "--tcp", "--port", str(PORT), "--image", str(image)]
    process = subprocess.Popen(
        [sys.executable, "-m", "ribbonhil", "serve", "wing", *options],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout
        line = next(line for line in process.stdout if line.startswith("ribbonhost stream"))
        yield shlex.split(line)[4:]
    finally:
        process.kill()
        process.communicate()


def test_ribbons_whose_image_restarts_are_found_and_set_up_again(tmp_path: Path) -> None:
    image = built()
    with serving(tmp_path, image) as urls:
        stream = subprocess.Popen(
            [*RIBBONHOST, "stream", "--comb", "comb.toml", *urls, "--rate", "50", "--json", "--seconds", "8"],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert stream.stdout
        while "report" not in json.loads(stream.stdout.readline()):
            pass
    with serving(tmp_path, image):
        out, err = stream.communicate(timeout=60)
    assert (stream.returncode, err) == (0, "")
    lines: list[dict[str, Any]] = [json.loads(line) for line in out.splitlines()]
    last = [line["report"] for line in lines if "report" in line][-1]
    for ribbon in last["ribbons"]:
        assert (ribbon["state"], ribbon["times_gone"]) == ("streaming", 1), ribbon
        assert ribbon["aligned"]
        assert ribbon["frames_per_s"] > 40
    assert last["comb"]["surfaces_per_s"] > 40
    assert sum("is back on" in str(line.get("event")) for line in lines) == 3
