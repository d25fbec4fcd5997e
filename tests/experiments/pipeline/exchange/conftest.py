"""Recordings that are read only."""

from pathlib import Path

import pytest

from tests.experiments.pipeline.exchange.recordings import write_filmed


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    write_filmed(folder)
    return folder
