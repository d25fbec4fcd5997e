"""One run of a subcommand: its messages, its progress and its output.

This module adds --json, --verbose, softaim.log and provenance.json to all subcommands.
"""

from __future__ import annotations

import inspect
import json
import logging
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from experiments.commands.options import AsJson, Verbose
from experiments.engine.progress import progress
from experiments.errors import InputError, shown
from experiments.log import LOG, SHOWN, Kept
from experiments.plain import plain

if TYPE_CHECKING:
    import typer

    from experiments.formats.scene.scene import Scene
    from experiments.formats.scene.schema import StepName
    from experiments.pipeline.events import Command

Advance = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """The result of a subcommand.

    record: the result for programs (--json); shown: the tables and lines of text for people
    fault: exception to raise after the result is printed; None if no part of the work failed
    """

    record: Mapping[str, Any]
    shown: Sequence[object]
    fault: Exception | None = None


@dataclass(slots=True, eq=False)
class Run:
    """A run of a subcommand.

    arguments: arguments of the command line, without passwords; log: all messages
    given: texts of the arguments and options that the user gave, by name; the text of the flag --force is "--force"
    opened: resources that are closed at the end of the run
    """

    command: str
    arguments: tuple[str, ...]
    log: Kept
    opened: ExitStack
    given: Mapping[str, str] = field(default_factory=dict)
    began: float = field(default_factory=time.time)
    _stage: Callable[[str], Advance] | None = None
    _scene: Scene | None = None
    _left_out: Mapping[str, str] = field(default_factory=dict)
    _reported: bool = True

    def stage(self, name: str) -> Advance:
        """Begin a stage of the work; returns a function that reports the finished share of the stage, from 0 to 1."""
        if self._stage is None:
            self._stage = self.opened.enter_context(progress())
        advance, began = self._stage(name), time.perf_counter()

        def done(share: float) -> None:
            self.begun()
            advance(share)
            if share >= 1.0:
                LOG.info("%s: %.2f s", name, time.perf_counter() - began)

        return done

    def only_with(self, other: str, *options: str) -> None:
        """Raise InputError if any of `options` was given without the option `other`."""
        for option in options if other not in self.given else ():
            if option in self.given:
                raise InputError.at(option, f"{other} beside it", "none")

    def not_with(self, other: str, *options: str) -> None:
        """Raise InputError if any of `options` was given together with the option `other`."""
        for option in options if other in self.given else ():
            if option in self.given:
                raise InputError.at(other, f"no {option} beside it", shown(self.given[option])[1:-1])

    def use(self, scene: Scene, before: Command | None = None) -> None:
        """Set the scene of this run. Find missing steps: commands, such as `identify`, that should have run before.

        before: the present command, None if it needs no earlier steps. `begun` reports the missing steps.
        Raises InputError if the scene's network is too large for a filter.
        """
        from experiments.pipeline.events import scene_line, steps_left_out

        if before not in (None, "simulate"):
            from experiments.pipeline.line import check_followed

            check_followed(scene)
        LOG.info("%s", scene_line(scene))
        self._scene = scene
        self._left_out = {} if before is None else steps_left_out(scene, before)
        self._reported = False

    def begun(self) -> None:
        """Report the missing steps found by `use`, at the first call only. Call this when all input has been read."""
        if not self._reported:
            self._reported = True
            for line in self._left_out.values():
                LOG.warning("%s", line)

    @contextmanager
    def folder(
        self, path: Path, *, force: bool = False, inputs: Sequence[Path | None] = (), growing: bool = False
    ) -> Iterator[Path]:
        """Context with an output folder. At its end, the folder receives the run's provenance and log.

        inputs: files and folders that the run reads; growing: whether written files stay after an exception
        """
        from experiments.formats.outputs import growing_folder, output_folder

        read = [one for one in inputs if one is not None and one.is_dir()]
        opened = growing_folder if growing else output_folder
        with opened(path, force=force, inputs=read) as folder:
            try:
                yield folder
            except BaseException:
                with suppress(InputError, OSError):  # for example, the folder was removed
                    if growing and any(folder.iterdir()):
                        self.finish(folder, path, inputs)
                raise
            self.finish(folder, path, inputs)

    def finish(self, folder: Path, named: Path, inputs: Sequence[Path | None] = ()) -> None:
        """Write the run's provenance and log to an existing folder; named: the folder's path for the log."""
        from experiments.formats.outputs import write_together
        from experiments.formats.provenance import LOG_FILE, PROVENANCE

        text = self._provenance(inputs)
        self.begun()
        LOG.info("%s: %.2f s in all; written to %s", self.command, time.time() - self.began, named)
        write_together({folder / PROVENANCE: text, folder / LOG_FILE: self.log.text()})

    def write_scene(
        self,
        scene: Scene,
        path: Path,
        step: StepName,
        *,
        recording: Path,
        inputs: Sequence[Path | None] = (),
        kept: Sequence[str] = (),
        force: bool = False,
    ) -> None:
        """Write a scene after a step such as `identify`, and a file beside it with the provenance. Raises InputError.

        kept: names of constants that the step did not change; force: whether to replace an existing mesh file
        """
        from experiments.formats.provenance import content_digest
        from experiments.formats.scene.scene import mesh_beside, scene_text, with_step
        from experiments.version import version

        self._scene = with_step(scene, step, version(), content_digest(recording), kept)
        self.write_files(
            {path: scene_text(self._scene), **mesh_beside(self._scene, path, force=force)}, [recording, *inputs]
        )

    def write_files(self, contents: Mapping[Path, str | bytes], inputs: Sequence[Path | None] = ()) -> None:
        """Write all files and the provenance, or no file; contents: content of each file. Raises InputError."""
        from experiments.formats.outputs import write_together
        from experiments.formats.provenance import beside

        self.begun()
        write_together({**contents, beside(next(iter(contents))): self._provenance(inputs)})

    @contextmanager
    def file(self, path: Path, *, force: bool = False, inputs: Sequence[Path | None] = ()) -> Iterator[BinaryIO]:
        """Context with an output file. At its end, the run's provenance is written beside the file.

        inputs: files and folders that the run reads. Raises InputError if the output file must not be written.
        """
        from experiments.formats.outputs import check_new, check_outside, streamed_file
        from experiments.formats.provenance import beside

        for folder in inputs:
            if folder is not None and folder.is_dir():
                check_outside(path, folder)
        check_new(path, force)
        with streamed_file(path, lambda: {beside(path): self._provenance(inputs)}) as file:
            yield file
            self.begun()

    def _provenance(self, inputs: Sequence[Path | None]) -> str:
        from experiments.engine.runs import program
        from experiments.formats.provenance import content_digest, provenance_text

        began = datetime.fromtimestamp(self.began, UTC)
        # any other input is a device, an address or a shipped scenario
        read = {one: content_digest(one) for one in inputs if one is not None and (one.is_file() or one.is_dir())}
        times = began, datetime.now(UTC)
        return provenance_text(self.command, self.arguments, program(), times, read, self._scene, tuple(self._left_out))


def subcommand(command: Callable[..., Answer]) -> Callable[..., None]:
    """The function that typer calls: it passes `run`, adds --json and --verbose, and prints the command's answer."""
    import typer

    name = command.__name__.replace("_", "-")
    signature = inspect.signature(command, eval_str=True)
    own = {key: one for key, one in signature.parameters.items() if key != "run"}
    common = {
        key: inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        for key, annotation in (("verbose", Verbose), ("as_json", AsJson))
    }

    @wraps(command)
    def called(context: typer.Context, *, verbose: bool, as_json: bool, **options: Any) -> None:
        given = _given(context)
        _check_names(given)
        # with --json, standard output has only the object
        with _logged(name, verbose, given) as run, redirect_stdout(sys.stderr if as_json else sys.stdout):
            answer = command(run, **options)
        if as_json:
            print(json.dumps(plain(answer.record), indent=2, ensure_ascii=False, allow_nan=False))
        else:
            for one in answer.shown:
                print(one) if isinstance(one, str) else print_table(one)
        if answer.fault is not None:
            raise answer.fault

    of_typer = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
    parameters = {"context": of_typer} | own | common
    called.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in parameters.values()]
    )
    called.__annotations__ = {key: one.annotation for key, one in parameters.items()}
    return called


def _given(context: typer.Context) -> dict[str, str]:
    """Texts of the arguments and options that the user gave, by name; the text of the flag --force is "--force"."""
    given: dict[str, str] = {}
    for one in context.command.params:
        source, value = context.get_parameter_source(one.name or ""), context.params.get(one.name or "")
        if source is None or source.name != "COMMANDLINE":
            continue
        name = one.secondary_opts[0] if value is False and one.secondary_opts else one.opts[0]
        given[name] = (
            name if isinstance(value, bool) else " ".join(map(str, value if isinstance(value, list) else [value]))
        )
    return given


def _check_names(given: Mapping[str, str]) -> None:
    """Raise InputError if an argument or the name of the current folder is not valid UTF-8."""
    with suppress(OSError):
        given = {"the current folder": os.getcwd(), **given}
    for name, text in given.items():
        try:
            text.encode("utf-8")
        except UnicodeEncodeError:
            found = os.fsencode(text).decode("utf-8", "backslashreplace")
            raise InputError.at(name, "a name in UTF-8", found) from None


@contextmanager
def _logged(name: str, verbose: bool, given: Mapping[str, str]) -> Iterator[Run]:
    from experiments.version import version

    kept = Kept()
    LOG.addHandler(kept)
    SHOWN.setLevel(logging.INFO if verbose else logging.WARNING)
    arguments = public(sys.argv[1:])
    try:
        LOG.info("softaim %s: %s", version(), " ".join(arguments))
        with ExitStack() as opened:
            yield Run(name, arguments, kept, opened, given)
    finally:
        SHOWN.setLevel(logging.WARNING)
        LOG.removeHandler(kept)


def public(arguments: Sequence[str]) -> tuple[str, ...]:
    """The arguments, without the user names and passwords in addresses of streams."""
    return tuple(re.sub(r"(?<=://)[^/]*@", "", argument) for argument in arguments)


def print_table(table: object) -> None:
    """Print a rich table to standard output."""
    from rich.console import Console

    # without markup: it would hide units in brackets
    Console(width=None if sys.stdout.isatty() else 110, markup=False).print(table)
