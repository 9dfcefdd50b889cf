"""Registration as a Bayes filter over the error of dead reckoning."""

from lgprjax.registration.bayes.drive import DriveFilter
from lgprjax.registration.bayes.likelihood import Likelihood, measure_likelihood

__all__ = ["DriveFilter", "Likelihood", "measure_likelihood"]
