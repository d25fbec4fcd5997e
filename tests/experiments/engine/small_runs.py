"""Functions on cases that the tests of the engine run on other processes."""

import os
import signal
import time
from pathlib import Path

import numpy as np


def drawn(case):
    """Numbers of the seed, and which process drew them."""
    time.sleep(0.02)
    rng = np.random.default_rng(case["seed"])
    return {"mean": rng.normal(size=10).mean(), "series": rng.normal(size=3), "pid": os.getpid()}


def paired(case):
    """Two rows; the number is whole for even seeds only."""
    half = case["seed"] / 2 if case["seed"] % 2 else case["seed"] // 2
    return [{"side": side, "half": half} for side in ("left", "right")]


def failing(case):
    """Every third seed fails while there is a file `broken`."""
    if case["seed"] % 3 == 0 and (Path(case["folder"]) / "broken").exists():
        raise ValueError(f"no {case['seed']}\nof these")
    return {"twice": 2 * case["seed"]}


def slow(case):
    """While it is held a while, from seed 5 on for as long; a letter in a file each time it is done."""
    held = Path(case["folder"]) / "held"
    while held.exists():
        time.sleep(0.05)
        if case["seed"] < 5:
            break
    with (Path(case["folder"]) / str(case["seed"])).open("a", encoding="utf-8") as file:
        file.write("x")
    return {"twice": 2 * case["seed"], "threads": os.environ.get("OPENBLAS_NUM_THREADS")}


def deadly(case):
    """Kills its process: seed 3 the first time only, seed 7 always."""
    seen = Path(case["folder"]) / str(case["seed"])
    if case["seed"] == 7 or (case["seed"] == 3 and not seen.exists()):
        seen.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"twice": 2 * case["seed"]}


def wrong(case):
    """What cannot be sent, cannot be a row, or has the name of a column of the case."""
    return {"sent": {"what": lambda: case}, "row": [], "name": {"seed": 1}}[case["how"]]
