"""Where real films and scans are that are not part of the repository: beside the checkout, or in SOFTAIM_DATA."""

import os
from pathlib import Path

DATA = Path(os.environ.get("SOFTAIM_DATA", Path(__file__).parents[2] / "shared" / "data"))
