"""The page in a real browser: what a person sees, and what its buttons do."""

import io
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import BrowserContext, Page, sync_playwright
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import Solved
from ribbonhost.record import Recording, is_complete
from view.commands import CHROMIUM, FLAGS, running

OUTPUT = Path(__file__).parent / "build"
"""Where the screenshots are kept."""

LIGHT = ("--motion", "off")
"""The browser, which draws by software, needs the processors."""

PATIENCE_S = 90.0
"""Whatever comes takes a moment, but not on a machine that has other work to do."""

SIZE = {"width": 980, "height": 440}
CANVAS = (slice(190, 430), slice(450, 660))
"""Rows and columns of a screenshot that hold the picture and neither panels nor notices."""


@pytest.fixture
def browser() -> Iterator[BrowserContext]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        context = browser.new_context(viewport=SIZE)
        context.set_default_timeout(PATIENCE_S * 1e3)
        yield context
        browser.close()


def until(page: Page, condition: Callable[[], object], what: str) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s, f"{what} did not come; the page says: {text_of(page)}"
        page.wait_for_timeout(50)


def text_of(page: Page) -> str:
    return page.inner_text("body")


def picture(page: Page, name: str = "") -> NDArray[np.int16]:
    """The part of the page that shows the ribbons, (rows, columns, 3)."""
    shot = page.screenshot()
    if name:
        OUTPUT.mkdir(exist_ok=True)
        (OUTPUT / f"{name}.png").write_bytes(shot)
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), np.int16)[CANVAS]


def share_of_surface(pixels: NDArray[np.int16]) -> float:
    """Of the picture: coloured as Viridis is, from violet over blue and green to yellow."""
    spread = pixels.max(axis=-1) - pixels.min(axis=-1)
    return float(np.mean((spread > 40) & (pixels.max(axis=-1) > 60)))


def share_of_ribbons(pixels: NDArray[np.int16]) -> float:
    """Of the picture: bright and without colour."""
    spread = pixels.max(axis=-1) - pixels.min(axis=-1)
    return float(np.mean((spread < 30) & (pixels.min(axis=-1) > 130)))


def share_of_truth(pixels: NDArray[np.int16]) -> float:
    """Of the picture: pink."""
    red, green, blue = np.moveaxis(pixels, -1, 0)
    return float(np.mean((red > 150) & (red - green > 60) & (blue - green > 40)))


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def check_the_picture(page: Page) -> None:
    until(page, lambda: share_of_surface(picture(page)) > 0.05, "a surface")
    pixels = picture(page, "live")
    assert 0.05 < share_of_surface(pixels) < 0.8
    assert 0.003 < share_of_ribbons(pixels) < 0.3
    choose(page, "smooth", "none")
    until(page, lambda: share_of_surface(picture(page)) < 0.02, "no surface")
    assert share_of_ribbons(picture(page)) > 0.003
    page.get_by_label("truth", exact=True).click()
    until(page, lambda: share_of_truth(picture(page)) > 0.0005, "the truth")
    assert share_of_truth(picture(page, "truth")) < 0.05
    page.get_by_label("truth", exact=True).click()
    choose(page, "none", "smooth")
    until(page, lambda: share_of_surface(picture(page)) > 0.05, "a surface again")


def choose(page: Page, chosen: str, option: str) -> None:
    """Changes a menu by what it shows now."""
    page.locator(f"input[value='{chosen}']").first.click()
    page.get_by_role("option", name=option, exact=True).click()


def check_scrubbing(page: Page) -> None:
    before = text_of(page)
    assert "live" in before
    slider = page.get_by_role("slider").first
    slider.focus()
    slider.press("Home")
    until(page, lambda: "paused" in text_of(page), "the pause")
    page.wait_for_timeout(400)
    old = picture(page, "paused")
    page.wait_for_timeout(300)
    assert np.mean(np.abs(picture(page) - old) > 40) < 0.002, "a paused picture stands still"
    press(page, "live")
    until(page, lambda: "paused" not in text_of(page), "the stream")
    until(page, lambda: np.mean(np.abs(picture(page) - old) > 40) > 0.01, "another moment")


def check_recording(page: Page, folder: Path) -> None:
    press(page, "Record")
    until(page, lambda: "Stop recording" in text_of(page), "the recording")
    until(page, lambda: re.search(r"\.mcap: 1 s", text_of(page)), "a second of it")
    press(page, "Stop recording")
    until(page, lambda: ": complete" in text_of(page), "its end")
    (file,) = folder.glob("*.mcap")
    assert is_complete(file)
    solved: list[Solved] = []
    replay = Replay([Recording(file)], motion="off", on_solved=[solved.append])
    for _ in replay.play():
        pass
    report = replay.report()
    assert sum(ribbon.counters.lost for ribbon in report.ribbons) == 0
    assert report.comb.surfaces > 30
    assert np.isfinite(solved[-1].node_m).all()


def test_a_person_looks_looks_back_and_records(browser: BrowserContext, tmp_path: Path) -> None:
    asked: set[str] = set()
    errors: list[str] = []
    with running(tmp_path, "stream", "--emulate", "wing", *LIGHT) as command:
        page = browser.new_page()
        page.on("request", lambda request: asked.add(request.url))
        page.on("websocket", lambda socket: asked.add(socket.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(command.url)
        until(page, lambda: "Connected" in text_of(page), "the connection")
        until(page, lambda: "6 ribbons, 100 Hz, 0 lost" in text_of(page), "the ribbons")
        until(page, lambda: "at 0.45 m" in text_of(page), "the table")
        check_the_picture(page)
        check_scrubbing(page)
        check_recording(page, tmp_path)
        page.close()
        *_, last = [line["summary"] for line in command.stop() if "summary" in line]
    assert last["lost"] == 0
    assert errors == []
    hosts = {urlsplit(url.removeprefix("blob:")).hostname for url in asked if not url.startswith("data:")}
    assert hosts == {"127.0.0.1"}, asked
    assert {urlsplit(url).scheme for url in asked} >= {"http", "ws"}

    (file,) = tmp_path.glob("*.mcap")
    with running(tmp_path, "replay", file, *LIGHT) as command:
        page = browser.new_page()
        page.goto(command.url)
        command.wait_for("summary")
        until(page, lambda: share_of_surface(picture(page)) > 0.05, "a surface of the recording")
        slider = page.get_by_role("slider").first
        slider.focus()
        slider.press("End")
        until(page, lambda: re.search(r"\d\.\d\d s, paused", text_of(page)), "its end")
        picture(page, "replay")
        command.stop()
