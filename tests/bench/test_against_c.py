"""The strapdown is what plain C makes of the same equations, and not slower than it may be."""

import pytest

from tests.bench import against_c

pytestmark = pytest.mark.skipif(against_c.compiler() is None, reason="no C compiler")


def test_same_results_as_in_c() -> None:
    mean, covariance = against_c.disagreement(against_c.in_c(), against_c.in_python)
    assert mean < 1e-9
    assert covariance < 1e-9


@pytest.mark.slow
def test_speed() -> None:
    """Ratio to C, and microseconds that hold on a machine with nothing else to do."""
    _, _, ratio = against_c.batches()
    _, update_ns = against_c.update_of_three_rows()
    assert ratio < 1.6
    assert against_c.one_at_a_time() < 4_000.0
    assert update_ns < 15_000.0
