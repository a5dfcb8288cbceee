"""The posterior Cramer-Rao bound: the covariance of a filter linearised along the truth.

The same filter on perfect data stays at the truth, so its covariance is that bound.
"""

from gateway.studies import errors
from gateway.studies.passage import Passage, configured, sail
from gateway.studies.voyage import Voyage


def along_truth(voyage: Voyage, **choices: str | float) -> Passage:
    """A passage without errors: ``sigma_n`` is the bound of each error at each epoch."""
    perfect = errors.without(voyage)
    return sail(voyage, perfect, configured(voyage.config, perfect, **choices))
