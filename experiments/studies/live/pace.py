"""Pace of a live run with a page and an OpenIGTLink client connected: latency, deadlines, memory.

    python -m experiments.studies.live.pace                 # 60 s at 60 frames/s
    python -m experiments.studies.live.pace --seconds 600

The simulated phantom, 640x480, with advice on a needle. Camera, loop and servers are processes of `softaim live`, the
clients are here: one for the page's stream with its pictures, one for OpenIGTLink. Prints the counts of `softaim live
--json`: frames, latency from exposure to estimate, share of missed deadlines, memory after the first frames and at the
end; messages of the clients per second, and the age of transforms at arrival; and the number of processors busy with
the run, with the clients and with other work: with much other work the figures depend on the machine.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from experiments.pipeline.live.outputs import Latencies
from experiments.servers.openigtlink.codec import HEADER, decode_header
from experiments.servers.openigtlink.outgoing import TARGET

NEEDLE = """
version = 1
entry_mm = [0.0, 215.0]
direction = [0.0, -1.0]
speed_mm_s = 200.0
[lesion]
radius_mm = 2.5
"""


@dataclass(slots=True)
class Got:
    """Messages of a client, pictures among them, and ages of transforms at arrival."""

    messages: int = 0
    pictures: int = 0
    ages: Latencies = field(default_factory=Latencies)


def page_client(address: str, got: Got) -> None:
    """Receive the page's stream like the page, until it ends."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    with connect(f"ws://{address}/stream?pictures=1&pace=1") as stream:
        try:
            while True:
                message = stream.recv()
                got.messages += isinstance(message, str)
                got.pictures += isinstance(message, bytes)
                if isinstance(message, str):
                    stream.send("next")
        except ConnectionClosed:
            return


def igtl_client(address: str, got: Got) -> None:
    """Receive OpenIGTLink's messages until they end."""
    host, _, port = address.rpartition(":")
    with socket.create_connection((host, int(port))) as connection, connection.makefile("rb") as stream:
        try:
            while len(found := stream.read(HEADER.size)) == HEADER.size:
                header = decode_header(found)
                if header.type == "TRANSFORM" and header.device == TARGET:
                    got.ages.add(1e3 * (time.time() - header.utc_s))
                got.messages += len(stream.read(header.size)) == header.size
        except ConnectionError:
            return


CLIENTS: dict[str, Callable[[str, Got], None]] = {"page: http://": page_client, "OpenIGTLink: ": igtl_client}
"""Clients by the address that a run prints."""


def watch(pid: int, spent_s: list[dict[str, float]]) -> None:
    """Record, each second, the time and the processor time of the run's processes, the clients, the machine [s]."""
    import psutil

    run, clients, used = psutil.Process(pid), psutil.Process(), dict[int, float]()
    try:
        while run.is_running():
            times = psutil.cpu_times()
            busy_s = sum(times) - times.idle - times.iowait - times.guest - times.guest_nice
            used |= {one.pid: sum(one.cpu_times()[:2]) for one in (run, *run.children(recursive=True))}
            own_s = sum(clients.cpu_times()[:2])
            spent_s.append({"at": time.monotonic(), "run": sum(used.values()), "clients": own_s, "all": busy_s})
            time.sleep(1.0)
    except psutil.NoSuchProcess:
        return


def busy(spent_s: list[dict[str, float]]) -> dict[str, float]:
    """Mean number of processors busy with the run, with the clients, with other work."""
    spent = {name: spent_s[-1][name] - spent_s[0][name] for name in spent_s[0]}
    spent["others"] = spent.pop("all") - spent["run"] - spent["clients"]
    over_s = spent.pop("at")
    return {f"cores_{name}": value / over_s for name, value in spent.items()}


def measured(seconds: float, fps: float) -> dict[str, float]:
    """The figures of a run of this duration and frame rate. Raises RuntimeError if it does not end normally."""
    got = {name: Got() for name in CLIENTS}
    spent_s: list[dict[str, float]] = []
    reported: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        needle = Path(folder) / "needle.toml"
        needle.write_text(NEEDLE, encoding="utf-8")
        words = [sys.executable, "-c", "from experiments.commands.app import main; main()", "live", "--json"]
        words += ["--out", f"{folder}/out", "--duration", str(seconds), "--fps", str(fps), "--needle", str(needle)]
        words += ["--page", "127.0.0.1:0", "--openigtlink", "127.0.0.1:0"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
            assert run.stderr is not None
            assert run.stdout is not None
            waiting = dict(CLIENTS)
            for line in run.stderr:
                reported.append(line)
                for name in [one for one in waiting if line.startswith(one)]:
                    beside(waiting.pop(name), line.removeprefix(name).split("/")[0].strip(), got[name])
                    if not waiting:
                        beside(watch, run.pid, spent_s)
            text = run.stdout.read()
    if run.returncode or not text:
        raise RuntimeError(f"softaim live ended with {run.returncode}: {''.join(reported[-5:])}")
    return figures(json.loads(text), list(got.values()), seconds) | busy(spent_s)


def beside(work: Callable[..., None], *given: object) -> None:
    """Run work in a thread that ends with the process."""
    threading.Thread(target=work, args=given, daemon=True).start()


def figures(done: Mapping[str, Any], got: Sequence[Got], seconds: float) -> dict[str, float]:
    """Counts of the run and its clients."""
    page, igtl = got
    began_mb, end_mb = done["memory_mb"]
    counted = {key: done[key] for key in ("frames", "without_frame", "not_used", "p50_ms", "p99_ms", "worst_ms")}
    return {
        **counted,
        "missed_share": done["deadlines_missed"] / done["frames"],
        "memory_begin_mb": began_mb,
        "memory_end_mb": end_mb,
        "page_states_s": page.messages / seconds,
        "page_pictures_s": page.pictures / seconds,
        "igtl_messages_s": igtl.messages / seconds,
        "igtl_age_p50_ms": igtl.ages.quantile_ms(0.5),
        "igtl_age_p99_ms": igtl.ages.quantile_ms(0.99),
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--fps", type=float, default=60.0)
    chosen = parser.parse_args()
    for name, value in measured(chosen.seconds, chosen.fps).items():
        sys.stdout.write(f"{name} {value:.5g}\n")


if __name__ == "__main__":
    main()
