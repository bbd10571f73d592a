"""Where captures and model disagree: tests of the residuals, with p-values and pictures.

Residuals are standard normal and independent when the model is right. Every test below has a null distribution that
follows from this alone. Parameters that were fitted to the same pixels can only take structure out of the residuals,
so that p-values err on the safe side: a matched model is called significant less often than stated.
"""

from sci_lightning.diagnosis.residual_tests.residual_test import Picture, ResidualTest
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

__all__ = ["Picture", "ResidualTest", "Residuals"]
