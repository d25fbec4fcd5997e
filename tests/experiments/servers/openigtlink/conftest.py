"""What holds for all tests of OpenIGTLink."""

import pytest

from experiments.log import LOG


@pytest.fixture(autouse=True)
def _no_fault_of_ours(caplog):
    """Whatever a client does is reported as the client's fault, never as an error."""
    LOG.addHandler(caplog.handler)
    yield
    LOG.removeHandler(caplog.handler)
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == []
