"""Registration as a Bayes filter over the error of dead reckoning."""

from lgprjax.registration.bayes.drive import DriveFilter
from lgprjax.registration.bayes.likelihood import Likelihood, measure_likelihood
from lgprjax.registration.bayes.register import filter_drive

__all__ = ["DriveFilter", "Likelihood", "filter_drive", "measure_likelihood"]
