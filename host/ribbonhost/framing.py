"""Frames on the link: COBS(packet + CRC-16), ended by a zero byte."""

from __future__ import annotations

import binascii

from ribbonhost.wire import MAX_PACKET_BYTES, WireError

CRC_BYTES = 2
DELIMITER = b"\0"
MAX_CONTENT_BYTES = MAX_PACKET_BYTES + CRC_BYTES
# Longer than this, what stands before a delimiter cannot be the COBS form of MAX_CONTENT_BYTES.
MAX_COBS_BYTES = MAX_CONTENT_BYTES + -(-MAX_CONTENT_BYTES // 254)


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, starts at 0xFFFF; 0x29B1 for b"123456789"."""
    return binascii.crc_hqx(data, 0xFFFF)


def crc32(data: bytes) -> int:
    """CRC-32 as in Ethernet and zip; 0xCBF43926 for b"123456789"."""
    return binascii.crc32(data)


def encode_frame(packet: bytes) -> bytes:
    """The frame of a packet, its delimiter included.

    Raises WireError if the packet is empty or longer than MAX_PACKET_BYTES.
    """
    if not 1 <= len(packet) <= MAX_PACKET_BYTES:
        raise WireError(f"A packet has 1 to {MAX_PACKET_BYTES} bytes, not {len(packet)}.")
    return _cobs_encode(packet + crc16(packet).to_bytes(CRC_BYTES, "little")) + DELIMITER


def _cobs_encode(content: bytes) -> bytes:
    frame = bytearray()
    run = b""
    for run in content.split(b"\0"):
        at = 0
        while len(run) - at >= 254:
            frame.append(0xFF)
            frame += run[at : at + 254]
            at += 254
        frame.append(len(run) - at + 1)
        frame += run[at:]
    if run and len(run) % 254 == 0:
        frame.pop()
    return bytes(frame)


def _cobs_decode(frame: bytes) -> bytes | None:
    """The content of a frame without its delimiter; None if a code byte points beyond the end."""
    content = bytearray(frame)
    full_blocks = []
    at = 0
    while at < len(frame):
        code = frame[at]
        content[at] = 0
        if code == 0xFF:
            full_blocks.append(at + 0xFF)
        at += code
    if at > len(frame):
        return None
    for end in reversed(full_blocks):
        del content[end : end + 1]
    return bytes(content[1:])


class Deframer:
    """Takes a stream of bytes apart; holds at most one frame, whatever arrives.

    crc_errors: frames with a wrong CRC. malformed: frames that are no COBS, too short for a packet and its
    CRC, or too long. After each delimiter everything is new; two delimiters in a row are no error.
    """

    def __init__(self) -> None:
        self.crc_errors = 0
        self.malformed = 0
        self._partial = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The packets that these bytes complete, in order."""
        *ended, rest = data.split(DELIMITER)
        packets = []
        if ended:
            ended[0] = self._partial + ended[0]
            self._partial = b""
            for frame in ended:
                packet = self._packet(frame)
                if packet:
                    packets.append(packet)
        # One byte more than the longest frame is enough to know that it is too long.
        self._partial = (self._partial + rest)[: MAX_COBS_BYTES + 1]
        return packets

    def _packet(self, frame: bytes) -> bytes:
        """The packet of a frame without its delimiter; empty, and counted, if it is none."""
        if not frame:
            return b""
        content = _cobs_decode(frame)
        if content is None or not CRC_BYTES < len(content) <= MAX_CONTENT_BYTES:
            self.malformed += 1
            return b""
        packet = content[:-CRC_BYTES]
        if crc16(packet) != int.from_bytes(content[-CRC_BYTES:], "little"):
            self.crc_errors += 1
            return b""
        return packet
