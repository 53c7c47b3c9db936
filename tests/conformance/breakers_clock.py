"""Responders that break a rule of the clock."""

from __future__ import annotations

import dataclasses

from conformance.responder import Responder
from conformance.rule_breakers import RuleBreakers
from ribbonhost import wire

BREAKERS = RuleBreakers()
breaks, alters = BREAKERS.breaks, BREAKERS.alters

alters("pong_echoes_the_ping", "tag 65535, saw 255", "pong", lambda pong, _: {"tag": pong.tag & 0xFF})
alters(
    "pong_echoes_the_ping",
    "t_host_us 18446744073709551615, saw 4294967295",
    "pong",
    lambda pong, _: {"t_host_us": pong.t_host_us % 2**32},
)
alters(
    "pong_times_are_in_order",
    "receive to transmit, saw -10",
    "pong",
    lambda pong, _: {"t_transmit_us": (pong.t_receive_us - 10) % 2**32},
)
alters(
    "pong_times_are_in_order",
    "receive to transmit, saw 200000",
    "pong",
    lambda pong, _: {"t_receive_us": (pong.t_transmit_us - 200_000) % 2**32},
)
for offset_us, says in (
    (10**8, "an ORIENT after .* saw none"),
    (-(10**8), "no t_us after a pong that came later, saw [0-9]+ us after"),
):
    alters(
        "scans_and_pongs_share_a_clock",
        says,
        "pong",
        lambda pong, _, offset_us=offset_us: {
            "t_receive_us": (pong.t_receive_us + offset_us) % 2**32,
            "t_transmit_us": (pong.t_transmit_us + offset_us) % 2**32,
        },
    )


@breaks("each_ping_has_one_pong", r"saw \[8\]")
class AnswersTheLastPingOnly(Responder):
    def receive(self, data: bytes) -> None:
        waiting = len(self.outbox)
        super().receive(data)
        pongs = [item for item in self.outbox if item[1][1] == wire.PacketId.CLOCK_PONG]
        for item in pongs[:-1]:
            self.outbox.remove(item)
        assert len(self.outbox) <= waiting + 8


@breaks("clock_never_goes_back", "-[0-9]+ us later")
class ClockGoesBack(Responder):
    pongs = 0

    def pong(self, tag: int, t_host_us: int) -> wire.ClockPong:
        self.pongs += 1
        pong = super().pong(tag, t_host_us)
        back_us = 1_000_000 * (self.pongs % 2)
        return dataclasses.replace(
            pong,
            t_receive_us=(pong.t_receive_us - back_us) % 2**32,
            t_transmit_us=(pong.t_transmit_us - back_us) % 2**32,
        )


@breaks("clock_keeps_time", "saw 1.0[23][0-9]* to 1.03")
class ClockTooFast(Responder):
    clock_ratio = 1.03


alters(
    "status_and_pongs_share_a_clock",
    "saw -999[0-9]+ us",
    "status",
    lambda status, _: {"t_us": (status.t_us - 10**8) % 2**32},
)
