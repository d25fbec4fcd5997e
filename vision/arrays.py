"""Types of arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

Image = NDArray[np.uint8]
"""A picture of 8 bits: (height, width, 3) in BGR order, or (height, width)."""

Picture = NDArray[Any]
"""A picture of integers or floating-point numbers, with the shapes of `Image`."""
