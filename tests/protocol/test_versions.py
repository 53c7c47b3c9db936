"""How versions of the schema live together: older hosts, newer devices, in both languages."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from generator import c
from generator.read import load
from ribbonhost import wire
from schemas import LATER, module_of

WARNINGS = (
    "-std=c11",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wshadow",
    "-Wvla",
    "-Wconversion",
    "-Wdouble-promotion",
)


def test_newer_packets_are_read_by_an_older_host(tmp_path: Path) -> None:
    later = module_of(LATER, tmp_path)
    nodes = later.NodeArray(
        q_world_node=np.eye(4), valid=np.ones(4, bool), quality=np.arange(4, dtype=np.uint8)
    )
    extras = later.ExtraArray(
        a=np.array([-(1 << 23), (1 << 23) - 1]),
        b=np.array([[-128, 127], [0, 1]]),
        c=np.array([0, (1 << 32) - 1]),
        d=np.array([0, (1 << 64) - 1], np.uint64),
        e=np.array([-(1 << 31), (1 << 31) - 1]),
        f=np.array([[1, 2, 3], [-1, -2, -3]]),
    )
    orient = later.Orient(t_us=7, sequence=8, nodes=nodes, tension_n=-3.5, turns=-(1 << 31), extras=extras)
    packet = later.encode(orient)
    again, surplus = later.decode(packet)
    assert surplus == 0
    assert (again.tension_n, again.turns) == (-3.5, -(1 << 31))
    for name in "abcdef":
        assert np.array_equal(getattr(again.extras, name), getattr(extras, name)), name
    old, surplus = wire.decode(packet)
    assert isinstance(old, wire.Orient)
    assert (old.t_us, old.sequence, len(old.nodes)) == (7, 8, 4)
    assert np.array_equal(old.nodes.q_world_node, np.eye(4))
    assert surplus == 1 + 4 + 1 + 2 * 24
    with pytest.raises(wire.UnknownPacketError):
        wire.decode(later.encode(later.Touch(force=-5)))
    with pytest.raises(later.MalformedPacketError):
        later.decode(wire.encode(old))


def test_c_of_another_schema_compiles_and_writes_the_same_bytes(tmp_path: Path) -> None:
    """Types that the schema does not use yet, in both languages."""
    later = module_of(LATER, tmp_path)
    (tmp_path / "wire.h").write_text(c.emit(load(LATER)))
    (tmp_path / "main.c").write_text(
        """
        #include <stdio.h>
        #include "wire.h"
        int main(void) {
            static const struct wire_orient orient = {
                .t_us = 7, .sequence = 8, .tension_n = -3.5f, .turns = INT32_MIN, .extra_count = 1,
                .extras = {{.a = -2, .b = {-128, 127}, .c = 4000000000u, .d = 1ull << 63, .e = -5,
                            .f = {1, 2, 3}}},
            };
            static struct wire_orient again;
            uint8_t out[WIRE_ORIENT_MAX_BYTES];
            const size_t n = wire_orient_pack(&orient, out, sizeof out);
            if (wire_orient_unpack(out, n, &again) != (int)n || memcmp(&orient, &again, sizeof again) != 0)
                return 1;
            for (size_t i = 0; i < n; i++)
                printf("%02x", out[i]);
            return 0;
        }
        """
    )
    program = tmp_path / "main"
    subprocess.run(["cc", *WARNINGS, "-o", program, tmp_path / "main.c", "-lm"], check=True)
    result = subprocess.run([program], capture_output=True, text=True, check=True)
    none = later.NodeArray(q_world_node=np.zeros((0, 4)), valid=np.zeros(0, bool), quality=np.zeros(0, int))
    extras = later.ExtraArray(
        a=np.array([-2]),
        b=np.array([[-128, 127]]),
        c=np.array([4000000000]),
        d=np.array([1 << 63], np.uint64),
        e=np.array([-5]),
        f=np.array([[1, 2, 3]]),
    )
    orient = later.Orient(t_us=7, sequence=8, nodes=none, tension_n=-3.5, turns=-(1 << 31), extras=extras)
    assert result.stdout == later.encode(orient).hex()
