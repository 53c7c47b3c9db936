"""Frames for other programs: other libraries read them, nobody waits for them, what is missed is counted."""

import asyncio
import json
import os
import queue
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ribbonhost.errors import RibbonError, UsageError
from ribbonhost.out import Facts, Feed, open_feed
from ribbonhost.out.server import LISTENER_FRAMES, ServerFeed
from ribbonhost.pipeline.matching import Match
from ribbonhost.pipeline.solving import Solved

LSL_DISCOVERY_PORT = 16_571
RIBBONS, NODES = 3, 16
FACTS = Facts(
    names=("reference", "left", "right"),
    serials=("aa" * 12, "bb" * 12, "cc" * 12),
    node_counts=(NODES,) * RIBBONS,
    pitches_m=(0.025,) * RIBBONS,
    start_m=(0.0, 0.15),
    rate_hz=100,
    unix_offset_s=1.7e9,
)


def solved(number: int, ribbons: int = RIBBONS) -> Solved:
    """A frame that is different each time."""
    random = np.random.default_rng(number)
    q = random.normal(size=(ribbons, NODES, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    valid = random.random((ribbons, NODES)) > 0.1
    sigma_rad = np.full((ribbons, NODES), 0.01)
    match = Match(100.0 + 0.01 * number, q, valid, valid, sigma_rad, (None,) * ribbons, {})
    return Solved(match, tuple(range(ribbons)), random.normal(size=(ribbons, NODES, 3)), None)


def opened(target: str, lines: Callable[[str], None] = lambda line: None) -> Feed:
    feed = open_feed(target, FACTS, lines)
    feed.start()
    return feed


def wait_for(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline_s, "did not come true in 10 s"
        time.sleep(0.005)


def check_frame(message: dict[str, Any], number: int) -> None:
    frame, truth = message["frame"], solved(number)
    assert frame["number"] == number
    assert frame["t_s"] == pytest.approx(truth.match.t_host_s, abs=1e-6)
    assert frame["ribbons"] == [0, 1, 2]
    np.testing.assert_allclose(frame["node_m"], truth.node_m, atol=1e-7)
    np.testing.assert_allclose(frame["q_world_node"], truth.match.q_world_node, atol=1e-6)
    np.testing.assert_array_equal(np.array(frame["valid"], bool), truth.match.valid)


def check_hello(message: dict[str, Any]) -> None:
    hello = message["ribbons"]
    assert (hello["version"], hello["rate_hz"], hello["start_m"]) == (1, 100, [0.0, 0.15])
    assert hello["ribbons"][1] == {"name": "left", "serial": "bb" * 12, "nodes": NODES, "pitch_m": 0.025}


def test_lines_say_who_the_ribbons_are_and_then_each_frame() -> None:
    lines: queue.Queue[str] = queue.Queue()
    feed = opened("ndjson", lines.put)
    for number in (1, 2, 3):
        feed(solved(number))
    check_hello(json.loads(lines.get(timeout=5)))
    for number in (1, 2, 3):
        check_frame(json.loads(lines.get(timeout=5)), number)
    feed.close()
    assert (feed.frames, feed.missed) == (3, 0)


def test_positions_that_are_not_known_are_null() -> None:
    lines: queue.Queue[str] = queue.Queue()
    feed = opened("ndjson", lines.put)
    frame = solved(1)
    frame.node_m[2, 5] = np.nan
    feed(frame)
    lines.get(timeout=5)
    text = lines.get(timeout=5)
    feed.close()
    assert "NaN" not in text
    assert json.loads(text)["frame"]["node_m"][2][5] == [None, None, None]


def test_a_target_that_does_not_take_frames_makes_nobody_wait_and_counts_what_it_misses() -> None:
    gate: queue.Queue[str] = queue.Queue(1)  # takes one line, then waits
    feed = opened("ndjson", gate.put)
    frame = solved(1)
    start_s = time.monotonic()
    for _ in range(500):
        feed(frame)
    assert time.monotonic() - start_s < 5
    assert feed.missed >= 400
    numbers = [json.loads(gate.get(timeout=5))["frame"]["number"] for _ in range(3) if gate.get(timeout=5)]
    assert numbers == sorted(numbers)
    while feed.frames + feed.missed < 500:
        gate.get(timeout=5)
    feed.close()


def listening(feed: Feed) -> int:
    assert isinstance(feed, ServerFeed)
    return feed.listeners


def test_all_websocket_listeners_get_all_and_a_slow_one_misses_alone() -> None:
    from websockets.sync.client import connect

    feed = opened("ws://127.0.0.1:0")
    with connect(feed.target) as quick, connect(feed.target, close_timeout=0.1) as slow:
        check_hello(json.loads(quick.recv(timeout=5)))
        wait_for(lambda: listening(feed) == 2)
        for number in range(1, 40):
            feed(solved(number))
            check_frame(json.loads(quick.recv(timeout=5)), number)
        assert feed.missed == 0
        slow.recv(timeout=5)
        check_frame(json.loads(slow.recv(timeout=5)), 1)
    feed.close()
    feed = opened("tcp://127.0.0.1:0")
    with tcp_listener(feed) as slow_socket, tcp_listener(feed) as quick_socket:
        wait_for(lambda: listening(feed) == 2)
        slow_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        with quick_socket.makefile("r") as lines:
            check_hello(json.loads(lines.readline()))
            for number in range(1, 1200):
                feed(solved(number % 5))
                assert json.loads(lines.readline())["frame"]["number"] == number
        assert feed.missed > 0, "what the one that never reads would have had to get"
        assert feed.frames > LISTENER_FRAMES
    wait_for(lambda: listening(feed) == 0)
    feed.close()
    assert feed.frames == 1199


def tcp_listener(feed: Feed) -> socket.socket:
    assert isinstance(feed, ServerFeed)
    return socket.create_connection(("127.0.0.1", feed.port), timeout=10)


def test_a_page_of_the_internet_may_not_listen() -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect
    from websockets.typing import Origin

    feed = opened("ws://127.0.0.1:0")
    try:
        with connect(feed.target, origin=Origin("http://localhost:3000")) as page:
            check_hello(json.loads(page.recv(timeout=5)))
        with pytest.raises(InvalidStatus, match="403"):
            connect(feed.target, origin=Origin("https://example.org"))
    finally:
        feed.close()


def test_servers_listen_on_the_address_that_was_typed_only() -> None:
    feed = opened("tcp://127.0.0.2:0")
    assert isinstance(feed, ServerFeed)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", feed.port), timeout=5)
    feed.close()


def test_osc_messages_are_what_a_library_reads() -> None:
    from pythonosc.osc_message import OscMessage

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5)
        feed = opened(f"osc://127.0.0.1:{receiver.getsockname()[1]}")
        for number in (1, 2):
            feed(solved(number))
        for number in (1, 2):
            truth = solved(number)
            for ribbon in range(RIBBONS):
                message = OscMessage(receiver.recv(65536))
                assert message.address == f"/ribbon/{ribbon}"
                version, count, t_s, nodes, invalid, *values = message.params
                assert (version, count, nodes) == (1, number, NODES)
                assert t_s == pytest.approx(truth.match.t_host_s, abs=1e-9)
                assert invalid == (~truth.match.valid[ribbon]).sum()
                rows = np.array(values).reshape(NODES, 7)
                np.testing.assert_allclose(rows[:, :3], truth.node_m[ribbon], atol=1e-6)
                np.testing.assert_allclose(rows[:, 3:], truth.match.q_world_node[ribbon], atol=1e-6)
        feed.close()


def test_lab_streaming_layer_delivers_samples_with_their_times() -> None:
    import pylsl

    feed = opened("lsl")
    try:
        found = {stream.name(): stream for stream in pylsl.resolve_byprop("type", "MoCap", RIBBONS, 10.0)}
        assert set(found) >= {"ribbon reference", "ribbon left", "ribbon right"}
        inlet = pylsl.StreamInlet(found["ribbon left"])
        inlet.open_stream(timeout=10.0)
        info = inlet.info(timeout=10.0)
        assert (info.nominal_srate(), info.channel_count()) == (100.0, 7 * NODES)
        assert info.desc().child_value("serial") == "bb" * 12
        channel = info.desc().child("channels").first_child()
        assert (channel.child_value("label"), channel.child_value("unit")) == ("node0_x", "metres")
        offset_s = pylsl.local_clock() - time.monotonic()
        for number in (1, 2, 3):
            feed(solved(number))
            sample, t_lsl_s = inlet.pull_sample(timeout=10.0)
            truth = solved(number)
            rows = np.array(sample).reshape(NODES, 7)
            np.testing.assert_allclose(rows[:, :3], truth.node_m[1], atol=1e-6)
            np.testing.assert_allclose(rows[:, 3:], truth.match.q_world_node[1], atol=1e-6)
            assert t_lsl_s == pytest.approx(truth.match.t_host_s + offset_s, abs=0.05)
        inlet.close_stream()
    finally:
        feed.close()


def test_lab_streaming_layer_is_found_at_the_loopback_address_only() -> None:
    """Its ports for samples listen everywhere, which is said: liblsl has no setting for them."""
    feed = opened("lsl")
    own = {os.readlink(fd) for fd in Path("/proc/self/fd").iterdir() if fd.is_symlink() and fd.exists()}
    rows = [line.split() for line in Path("/proc/self/net/udp").read_text().splitlines()[1:]]
    addresses = {row[1] for row in rows if f"socket:[{row[9]}]" in own}
    feed.close()
    port = f"{LSL_DISCOVERY_PORT:04X}"
    assert f"0100007F:{port}" in addresses
    assert f"00000000:{port}" not in addresses
    assert "listens at all network addresses" in feed.note


@pytest.mark.parametrize(
    "target",
    ["", "nd", "http://127.0.0.1:80", "ws://127.0.0.1", "osc://:9000", "ws://h:1/x", "tcp://h:99999"],
)
def test_what_is_no_target_is_wrong_usage(target: str) -> None:
    with pytest.raises(UsageError, match="is none of what can be: ndjson, ws://"):
        open_feed(target, FACTS, lambda line: None)


def test_a_port_in_use_is_one_sentence() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(RibbonError, match=rf"--out tcp://127.0.0.1:{port}: the port cannot be had"):
            open_feed(f"tcp://127.0.0.1:{port}", FACTS, lambda line: None)


def test_an_event_loop_is_given_back_when_the_port_is_in_use(recwarn: pytest.WarningsRecorder) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(RibbonError):
        open_feed(f"ws://127.0.0.1:{taken.getsockname()[1]}", FACTS, lambda line: None)
    with pytest.raises(RuntimeError):
        asyncio.get_running_loop()
    assert not [warning for warning in recwarn if issubclass(warning.category, ResourceWarning)]
