"""How far a quaternion turns on its way through the wire, over a million random attitudes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from ribbonhil._firmware import ffi, lib
from ribbonhost import wire

ATTITUDES = 1_000_000
FORMS = pytest.mark.parametrize(
    ("name", "worst_deg"), [("orient", 0.0075), ("orient_compact", 0.26)], ids=["full", "compact"]
)
ARRAYS = {"orient": ("node", wire.NodeArray), "orient_compact": ("node_compact", wire.NodeCompactArray)}
HEAD_BYTES = 8
Quaternions = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def attitudes() -> Quaternions:
    """(ATTITUDES, 4) unit quaternions, uniform over all rotations."""
    q = np.random.default_rng(2011).standard_normal((ATTITUDES, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def angle_deg(one: Quaternions, other: Quaternions) -> npt.NDArray[np.float64]:
    """Between two sets of orientations (n, 4), accurate for small angles."""
    chord = np.minimum(np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1))
    return np.degrees(4 * np.arcsin(chord / 2))


def c_layout(name: str) -> np.dtype[np.void]:
    """The C structure of a packet as a NumPy type."""
    node = f"struct wire_{ARRAYS[name][0]}"
    members = {"q_world_node": ("<f4", (4,)), "q_world_node_valid": "?", "quality": "u1"}
    nodes = np.dtype(
        {
            "names": list(members),
            "formats": list(members.values()),
            "offsets": [ffi.offsetof(node, m) for m in members],
            "itemsize": ffi.sizeof(node),
        }
    )
    packet = f"struct wire_{name}"
    return np.dtype(
        {
            "names": ["node_count", "nodes"],
            "formats": ["u1", (nodes, (wire.NODE_MAX,))],
            "offsets": [ffi.offsetof(packet, "node_count"), ffi.offsetof(packet, "nodes")],
            "itemsize": ffi.sizeof(packet),
        }
    )


def c_packets(name: str, q: Quaternions) -> npt.NDArray[np.uint8]:
    """(n, packet bytes), of 32 nodes each."""
    packets = np.zeros(len(q) // wire.NODE_MAX, c_layout(name))
    packets["node_count"] = wire.NODE_MAX
    packets["nodes"]["q_world_node"] = q.reshape(-1, wire.NODE_MAX, 4)
    packets["nodes"]["q_world_node_valid"] = True
    size = int(getattr(lib, f"WIRE_{name.upper()}_MAX_BYTES"))
    out = np.zeros((len(packets), size), np.uint8)
    source = ffi.cast(f"struct wire_{name} *", ffi.from_buffer(packets))
    target = ffi.cast("uint8_t *", ffi.from_buffer(out))
    pack = getattr(lib, f"wire_{name}_pack")
    assert all(pack(source + i, target + i * size, size) == size for i in range(len(packets)))
    return out


def c_quaternions(name: str, packed: npt.NDArray[np.uint8]) -> Quaternions:
    """The nodes of packets, as the C codec reads them."""
    packets = np.zeros(len(packed), c_layout(name))
    target = ffi.cast(f"struct wire_{name} *", ffi.from_buffer(packets))
    source = ffi.cast("uint8_t *", ffi.from_buffer(packed))
    size = packed.shape[1]
    unpack = getattr(lib, f"wire_{name}_unpack")
    assert all(unpack(source + i * size, size, target + i) == size for i in range(len(packed)))
    assert packets["nodes"]["q_world_node_valid"].all()
    return packets["nodes"]["q_world_node"].reshape(-1, 4).astype(float)


@FORMS
def test_quantisation_is_within_its_limit_in_both_languages(
    name: str, worst_deg: float, attitudes: Quaternions
) -> None:
    packed = c_packets(name, attitudes)
    assert angle_deg(attitudes, c_quaternions(name, packed)).max() <= worst_deg
    words = packed[:, HEAD_BYTES:].reshape(ATTITUDES, -1)[:, :-1]
    _, array = ARRAYS[name]
    nodes = array(
        q_world_node=attitudes, valid=np.ones(ATTITUDES, bool), quality=np.zeros(ATTITUDES, np.uint8)
    )
    write, read = (getattr(wire, f"_{verb}_{ARRAYS[name][0]}") for verb in ("write", "read"))
    by_python = write(nodes, ATTITUDES, "nodes")
    assert np.array_equal(np.frombuffer(by_python, np.uint8).reshape(ATTITUDES, -1)[:, :-1], words)
    decoded = read(by_python, 0, ATTITUDES)
    assert decoded.valid.all()
    assert angle_deg(attitudes, decoded.q_world_node).max() <= worst_deg


@pytest.mark.parametrize(("name", "worst_deg"), [("orient", 0.00496), ("orient_compact", 0.159)])
def test_no_attitude_is_worse_than_the_nearest_codes_allow(name: str, worst_deg: float) -> None:
    """Four components of nearly one size are worst: rounding each of them errs by 0.0086 and 0.275 deg."""
    random = np.random.default_rng(2012)
    q = random.choice([-1.0, 1.0], (ATTITUDES, 4)) + random.uniform(-0.02, 0.02, (ATTITUDES, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    assert angle_deg(q, c_quaternions(name, c_packets(name, q))).max() <= worst_deg


def test_sign_length_and_order_of_operations_do_not_matter(attitudes: Quaternions) -> None:
    some = attitudes[: 32 * 1000]
    assert np.array_equal(c_packets("orient", some), c_packets("orient", -some))
    longer = c_quaternions("orient", c_packets("orient", some * 3.7))
    assert angle_deg(some, longer).max() <= 0.0075
