"""The board that is made of memory: time that is told, a link with a speed, flash that behaves like flash."""

from __future__ import annotations

import pytest
from ribbonhil._firmware import ffi, lib

NS = 1_000_000_000


def new_board():
    board = ffi.new("struct board *")
    lib.host_board_init(board)
    return board


@pytest.mark.parametrize("ppm", [-100.0, 0.0, 35.0])
def test_waiting_ends_when_the_device_clock_gets_there(ppm):
    board = new_board()
    board.clock_ratio = 1 + ppm * 1e-6
    board.clock_offset_us = 2**32 - 5_000_000
    for i in range(1, 400):
        wanted_us = (board.clock_offset_us + i * 33_333) % 2**32
        lib.board_wait_until(board, wanted_us)
        assert (lib.board_now_us(board) - wanted_us) % 2**32 <= 1
        assert board.t_ns == pytest.approx(i * 33_333_000 / board.clock_ratio, abs=2000)


def test_waiting_never_passes_the_horizon_and_tells_when_it_would_wake():
    board = new_board()
    board.horizon_ns = 400_000
    lib.board_wait_until(board, 1000)
    assert (board.t_ns, board.wake_ns) == (400_000, 1_000_000)
    lib.board_wait_until(board, 1000)
    assert board.t_ns == 400_000


def test_waiting_for_the_past_takes_no_time():
    board = new_board()
    board.t_ns = 5_000_000
    lib.board_wait_until(board, 4000)
    assert board.t_ns == 5_000_000


def test_arriving_byte_ends_a_wait_once():
    board = new_board()
    assert lib.host_board_write(board, b"abc", 3) == 3
    lib.board_wait_until(board, 1000)
    assert board.t_ns == 0
    lib.board_wait_until(board, 1000)
    assert board.t_ns == 1_000_000, "bytes that were there already do not"
    got = ffi.new("uint8_t[]", 8)
    assert bytes(ffi.buffer(got, lib.board_link_read(board, got, 8))) == b"abc"


def test_received_bytes_that_do_not_fit_are_told():
    board = new_board()
    size = lib.HOST_BOARD_RX_BYTES
    assert lib.host_board_write(board, bytes(size + 10), size + 10) == size
    assert lib.host_board_write(board, b"x", 1) == 0


def test_bytes_leave_at_the_baud_rate():
    """One byte every ten bit times."""
    board = new_board()
    board.baud = 115_200
    data = ffi.new("uint8_t[]", bytes(range(100)))
    assert lib.board_link_send(board, data, 100)
    assert not lib.board_link_send(board, data, 100), "one send at a time"
    got = ffi.new("uint8_t[]", 200)
    board.t_ns = round(49.9 * 10 / 115_200 * NS)
    assert lib.host_board_read(board, got, 200) == 49
    assert lib.board_link_sending(board)
    lib.board_wait_until(board, 1_000_000)
    assert board.t_ns == pytest.approx(100 * 10 / 115_200 * NS, abs=1)
    assert lib.host_board_read(board, got, 200) == 51
    assert bytes(ffi.buffer(got, 51)) == bytes(range(49, 100))
    assert not lib.board_link_sending(board)
    assert lib.host_board_send_end_ns(board) == 2**64 - 1


def test_flash_bits_can_be_cleared_once_and_only_words_are_written():
    board = new_board()
    assert lib.board_store_write(board, 0, 8, b"\x0f\xf0\xff\x55", 4)
    assert lib.board_store_write(board, 0, 8, b"\xff\x0f\xff\xff", 4)
    got = ffi.new("uint8_t[4]")
    lib.board_store_read(board, 0, 8, got, 4)
    assert bytes(got) == b"\x0f\x00\xff\x55"
    assert not lib.board_store_write(board, 0, 2, b"abcd", 4)
    assert not lib.board_store_write(board, 0, 0, b"abc", 3)
    assert not lib.board_store_write(board, 0, lib.BOARD_STORE_BYTES, b"abcd", 4)
    assert lib.board_store_erase(board, 0)
    lib.board_store_read(board, 0, 8, got, 4)
    assert bytes(got) == b"\xff" * 4
