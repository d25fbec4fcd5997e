"""Types of arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

Image = NDArray[np.uint8]
"""A picture of 8 bits, (height, width, 3) in the order BGR, or (height, width)."""

Picture = NDArray[Any]
"""A picture with the types of OpenCV's stubs: integers or floating-point numbers, shaped as `Image`."""
