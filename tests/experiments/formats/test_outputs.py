"""Folders and files appear whole or not at all."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.errors import InputError
from experiments.formats import outputs
from experiments.formats.outputs import check_outside, output_folder, streamed_file, write_whole
from tests.experiments.rows import complaint


def tree(folder: Path) -> dict[str, str]:
    """All files below a folder with their content, hidden ones included."""
    return {str(p.relative_to(folder)): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()}


def fill(out: Path, files: dict[str, str], *, force: bool = False, then: Callable[[], None] = lambda: None) -> None:
    """Write files to an output folder, then do something else in its context."""
    with output_folder(out, force=force) as folder:
        for name, content in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(content)
        then()


def failing(error: BaseException | type[BaseException]) -> Callable[..., None]:
    """A function that raises the error, whatever it is given."""

    def fail(*_args: object, **_kwargs: object) -> None:
        raise error

    return fail


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "out"


@pytest.mark.parametrize("exists", [False, True])
def test_files_appear_at_a_clean_exit_and_not_before(tmp_path: Path, out: Path, exists: bool):
    if exists:
        out.mkdir(parents=True)
    with output_folder(out) as folder:
        (folder / "sub").mkdir()
        (folder / "a.csv").write_text("a")
        (folder / "sub" / "b.csv").write_text("b")
        assert folder != out
        assert not exists or tree(out) == {}
        assert exists or not out.exists()
    assert tree(tmp_path) == {"deep/out/a.csv": "a", "deep/out/sub/b.csv": "b"}
    assert out.stat().st_mode & 0o777 == tmp_path.joinpath("deep").stat().st_mode & 0o777


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit, InputError])
@pytest.mark.parametrize("force", [False, True])
def test_nothing_appears_after_an_exception(tmp_path: Path, out: Path, error: type[BaseException], force: bool):
    if force:
        out.mkdir(parents=True)
        (out / "a.csv").write_text("old")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(error):
        fill(out, {"a.csv": "new"}, force=force, then=failing(error))
    assert sorted(tmp_path.rglob("*")) == before
    assert tree(tmp_path) == ({"deep/out/a.csv": "old"} if force else {})


def test_force_replaces_what_is_written_and_leaves_the_rest(tmp_path: Path):
    for name in ("mine.txt", "a.csv", "sub/b.csv", "sub/mine.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("old")
    fill(tmp_path, {"a.csv": "new", "sub/b.csv": "new", "sub/new/c.csv": "new"}, force=True)
    expected = {"mine.txt": "old", "a.csv": "new", "sub/b.csv": "new", "sub/mine.txt": "old", "sub/new/c.csv": "new"}
    assert tree(tmp_path) == expected


def test_a_folder_filled_meanwhile_is_not_written_over(out: Path):
    def meddle() -> None:
        out.mkdir(parents=True)
        (out / "a.csv").write_text("theirs")

    assert "--force" in complaint(fill, out, {"a.csv": "ours"}, then=meddle)
    assert tree(out.parent) == {"out/a.csv": "theirs"}


@pytest.mark.parametrize(("mine", "written", "message"), [("a/b", "a", "a folder"), ("a", "a/b", "a file")])
def test_a_file_in_place_of_a_folder_or_the_reverse_stops_all(tmp_path: Path, mine: str, written: str, message: str):
    out = tmp_path / "out"
    (out / mine).parent.mkdir(parents=True)
    (out / mine).write_text("mine")
    assert complaint(fill, out, {"0.csv": "new", written: "new"}, force=True).endswith(f"found {message}")
    assert tree(tmp_path) == {f"out/{mine}": "mine"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(errno.EACCES, "Permission denied")])
@pytest.mark.parametrize("fails_at", range(1, 6))  # two renames for each file that is replaced, one for a new one
def test_moving_files_over_is_undone_when_it_fails(tmp_path, monkeypatch, error, fails_at):
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.csv").write_text("old a")
    (out / "c.csv").write_text("old c")
    rename, calls = Path.rename, 0

    def counted(self: Path, target: Path) -> Path:
        nonlocal calls
        calls += 1
        if calls == fails_at:
            raise error
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", counted)
    with pytest.raises((KeyboardInterrupt, InputError)):
        fill(out, {"a.csv": "new", "new/b.csv": "new", "c.csv": "new"}, force=True)
    assert tree(tmp_path) == {"out/a.csv": "old a", "out/c.csv": "old c"}
    assert sorted(tmp_path.rglob("*")) == [out, out / "a.csv", out / "c.csv"]


def test_a_file_is_no_folder_to_write_into(tmp_path: Path):
    (tmp_path / "file").write_text("mine")
    for path, message in ((tmp_path / "file", "found a file"), (tmp_path / "file" / "out", "found not a directory")):
        with pytest.raises(InputError, match=message), output_folder(path, force=True):
            pytest.fail("work was begun")
    assert tree(tmp_path) == {"file": "mine"}


@pytest.mark.parametrize(
    ("where", "source"),
    [
        ("rec", "rec"),
        *(("rec/out", "rec"), (".", "rec"), ("rec/../rec", "rec"), ("link", "rec"), ("rec", "link")),
        (".", "rec/scene.toml"),
    ],
)
def test_what_is_read_is_not_written_over_even_with_force(tmp_path: Path, where: str, source: str):
    (tmp_path / "rec").mkdir()
    (tmp_path / "rec" / "scene.toml").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "rec")
    found = "the same" if (tmp_path / where).resolve() == (tmp_path / source).resolve() else "one in the other"
    with (
        pytest.raises(InputError, match=f"expected a folder apart from .*(rec|link).*, found {found}$"),
        output_folder(tmp_path / where, force=True, inputs=[tmp_path / source]),
    ):
        pytest.fail("work was begun")


def test_a_relative_folder_is_written_where_the_program_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with output_folder(Path("out")) as folder:
        (folder / "a").write_text("a")
    monkeypatch.chdir(tmp_path / "out")
    with output_folder(Path(), force=True) as folder:
        (folder / "b").write_text("b")
    assert tree(tmp_path) == {"out/a": "a", "out/b": "b"}
    assert Path("b").read_text() == "b"


@pytest.mark.parametrize("refused", ["parent", "other file system"])
def test_a_folder_whose_parent_is_closed_is_written_from_within(tmp_path, monkeypatch, refused):
    out = tmp_path / "out"
    out.mkdir()
    mkdir, stat = Path.mkdir, Path.stat

    class Elsewhere:
        st_dev = -1

    if refused == "parent":  # as for the superuser nothing is closed, the closed door is painted

        def closed(self: Path, *args: int, **kwargs: bool) -> None:
            if self.parent == tmp_path:
                raise PermissionError(errno.EACCES, "Permission denied")
            mkdir(self, *args, **kwargs)

        monkeypatch.setattr(Path, "mkdir", closed)
    else:
        monkeypatch.setattr(Path, "stat", lambda self, **kw: Elsewhere() if self == tmp_path else stat(self, **kw))
    with output_folder(out) as folder:
        assert folder.parent == out
        (folder / "a").write_text("a")
    monkeypatch.undo()
    assert tree(tmp_path) == {"out/a": "a"}


def test_a_closed_parent_and_a_full_disk_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as patch:
        patch.setattr(Path, "mkdir", failing(PermissionError(errno.EACCES, "Permission denied")))
        assert complaint(fill, tmp_path / "out", {}).endswith(
            "out: expected a folder that can be written, found permission denied"
        )
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert complaint(fill, tmp_path / "out", {"a": "a"}, then=failing(full)).endswith(
        "out: expected room to write, found no space left on device"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_written_whole(tmp_path: Path):
    path = tmp_path / "a.txt"
    write_whole(path, "é\n")
    assert path.read_bytes() == b"\xc3\xa9\n"
    write_whole(path, b"\x00\r\n")
    assert path.read_bytes() == b"\x00\r\n"
    (tmp_path / "link").symlink_to(path)
    write_whole(tmp_path / "link", "through")
    assert path.read_text() == "through"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "link"]


def test_the_old_file_stays_when_the_new_one_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "a.txt"
    path.write_text("old")

    monkeypatch.setattr(outputs.os, "fsync", failing(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    assert "a.txt: expected a file that can be written, found no space left" in complaint(write_whole, path, "new")
    assert tree(tmp_path) == {"a.txt": "old"}


def test_only_files_are_written_over(tmp_path: Path):
    assert complaint(write_whole, tmp_path, "x").endswith("expected a file, found a folder")
    os.mkfifo(tmp_path / "pipe")
    assert complaint(write_whole, tmp_path / "pipe", "x").endswith("expected a file, found a device")


@pytest.mark.parametrize("before", [{}, {"film.mcap": "old"}])
def test_a_streamed_file_stands_there_when_it_is_whole(tmp_path: Path, before: dict[str, str]) -> None:
    for name, content in before.items():
        (tmp_path / name).write_text(content)
    with streamed_file(tmp_path / "film.mcap") as file:
        file.write(b"one ")
        file.write(b"two")
        file.flush()
        assert {name: text for name, text in tree(tmp_path).items() if name == "film.mcap"} == before
    assert tree(tmp_path) == {"film.mcap": "one two"}


def test_a_streamed_file_needs_a_folder(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=r"film.mcap: expected a file that can be written, found no such file"),
        streamed_file(tmp_path / "none" / "film.mcap"),
    ):
        pass


def test_a_file_in_a_folder_that_is_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rec" / "deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "rec")
    for path in (tmp_path / "rec" / "deep" / "film.mcap", tmp_path / "link" / "film.mcap"):
        with pytest.raises(InputError, match=r"film.mcap: expected a file outside of .*rec, which is read, found one"):
            check_outside(path, tmp_path / "rec")
    check_outside(tmp_path / "record.mcap", tmp_path / "rec")
