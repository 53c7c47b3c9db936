"""Takes the pictures of README.md: the page as it is, and the surface over one period, looped.

Run by `make pictures`. An emulated comb streams and is recorded; Debian's chromium shows the page.
"""

import io
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright
from ribbonhost.pipeline.replay import Replay
from ribbonhost.record import Recording
from ribbonhost.view import View
from view.commands import COMMAND, FLAGS, running

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
CHROMIUM = Path(__file__).parent / "quiet-chromium"

PAGE = {"width": 1480, "height": 830}
STREAM_S = 27.0
"""The plots then show more than a period of the motion."""

PERIOD_S = 20.0
FRAMES = 50
FRAME_MS = 80
WINDOW = {"width": 1580, "height": 560}
FILM_CLIP = {"x": 500, "y": 0, "width": 705, "height": 470}
"""Of the window: between the panels."""

FILM = (600, 400)
SETTLE_MS = 150


def close_notice(page: Page) -> None:
    """The page says that it is drawn by software: true, and nothing of this project."""
    page.wait_for_selector("canvas")
    page.wait_for_selector(".mantine-Notification-root")
    page.evaluate("document.querySelectorAll('.mantine-Notification-root').forEach(n => n.remove())")


def take_page(browser: Browser, scene: str, path: Path) -> None:
    """The whole page while a stream runs; drawing by software leaves no processor for estimating motion."""
    with (
        tempfile.TemporaryDirectory() as folder,
        running(Path(folder), "stream", "--emulate", scene, "--motion", "off") as stream,
    ):
        page = browser.new_page(viewport=PAGE)  # type: ignore[arg-type]
        stream.wait_for("report")
        page.goto(stream.url)
        close_notice(page)
        page.wait_for_timeout(STREAM_S * 1e3)
        page.screenshot(path=path)
        page.close()


def drawn(page: Page, before: bytes) -> bytes:
    """The picture once it is another than before and stands still."""
    last = b""
    for _ in range(100):
        shot = page.screenshot(clip=FILM_CLIP)  # type: ignore[arg-type]
        if shot == last != before:
            break
        last = shot
        page.wait_for_timeout(SETTLE_MS)
    return last


def take_film(browser: Browser, scene: str, path: Path) -> None:
    """The surface over one period, each moment of a recording drawn whole."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "film.mcap"
        record = [*COMMAND, "record", str(file), "--emulate", scene, "--seconds", str(PERIOD_S + 1.0)]
        subprocess.run(record, check=True, stdout=subprocess.DEVNULL)
        replay = Replay(
            [Recording(file)],
            on_solved=[lambda solved: view.keep(solved, solved.match.t_host_s - replay.t_zero_s)],
        )
        view = View(replay.arrangement, method=replay.method, live=False, port=0)
        for _ in replay.play():
            pass
    view.settings.names = False
    view.settings.colour = "height"
    view.seek(0.5)
    page = browser.new_page(viewport=WINDOW)  # type: ignore[arg-type]
    page.goto(view.url)
    close_notice(page)
    page.wait_for_timeout(3000)
    images, shot = [], b""
    for k in range(FRAMES):
        view.seek(0.5 + PERIOD_S * k / FRAMES)
        shot = drawn(page, shot)
        image = Image.open(io.BytesIO(shot)).convert("RGB")
        images.append(image.resize(FILM, Image.Resampling.LANCZOS))
    page.close()
    view.close()
    film: dict[str, Any] = {"duration": FRAME_MS, "loop": 0, "quality": 70, "method": 6}
    images[0].save(path, save_all=True, append_images=images[1:], **film)


def main() -> None:
    """Writes the pictures and says how large they are."""
    PICTURES.mkdir(exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        take_page(browser, "wing", PICTURES / "page.png")
        take_film(browser, "sea", PICTURES / "surface.webp")
        browser.close()
    for path in sorted(PICTURES.iterdir()):
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
