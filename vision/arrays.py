"""Types of arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

Image = NDArray[np.uint8]
"""A picture, (height, width, 3) in the order BGR, or (height, width)."""

Picture = NDArray[Any]
"""The same as OpenCV's stubs have it: of whole or of floating numbers."""
