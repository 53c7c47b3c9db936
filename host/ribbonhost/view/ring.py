"""Places for rows of arrays: when they are full, the oldest go, or every second one."""

import numpy as np
from numpy.typing import NDArray


class Ring:
    """Says where in arrays of `capacity` rows the next row goes.

    If it `thins`, what is full loses every second row, and from then on only every second of the rows that
    come is kept; otherwise the oldest row goes.
    """

    def __init__(self, capacity: int, *, thins: bool) -> None:
        self._capacity = capacity
        self._thins = thins
        self._stride, self._passed = 1, 0
        self._first = self.count = 0

    def next(self, *arrays: NDArray[np.generic]) -> int | None:
        """The place of the next row in these arrays; None if it is not kept."""
        self._passed += 1
        if self._passed < self._stride:
            return None
        self._passed = 0
        if self.count == self._capacity:
            if self._thins:
                self._thin(arrays)
            else:
                self._first = (self._first + 1) % self._capacity
                self.count -= 1
        self.count += 1
        return self.place(self.count - 1)

    def place(self, index: int) -> int:
        """Where the row is that is older than all but `index` others."""
        return (self._first + index) % self._capacity

    def places(self) -> NDArray[np.int64]:
        """Of all rows, the oldest first."""
        return (self._first + np.arange(self.count)) % self._capacity

    def _thin(self, arrays: tuple[NDArray[np.generic], ...]) -> None:
        # One that thins never dropped its oldest: it begins at place 0.
        half = (self.count + 1) // 2
        for array in arrays:
            array[:half] = array[: self.count : 2].copy()
        self.count = half
        self._stride *= 2
