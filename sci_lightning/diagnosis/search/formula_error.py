"""How far the formula of an effect may be trusted: an error along the effect's own direction, in all pixels alike.

No formula is exact. A modulator has gaps between its mirrors, light is not spread as evenly as a model says, and what
an effect changes is then a little less or more than its formula says, everywhere together. Pixels do not average such
an error away: it is added to what they say about a parameter, and an effect that is no larger has no evidence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.encoder.effects.parameter import Parameter, Value


@dataclass(frozen=True)
class FormulaError:
    """Standard deviation of a formula's error.

    Attributes:
        share: of the distance of a parameter from its neutral value.
        steps: of the parameter, however large it is (``Parameter.step``, the least difference that is easily seen).
    """

    share: float
    steps: float

    def of(self, value: Value, about: Parameter) -> float:
        """Return it in the parameter's unit; 0 for a choice.

        Where there is no neutral value (a phase), or where that is a bound that stands for infinity (a full well), it
        is the share of the value itself.
        """
        if about.choices or not isinstance(value, (int, float)):
            return 0.0
        if about.log or not isinstance(about.neutral, (int, float)):
            return self.share * abs(float(value))
        distance = abs(float(value) - about.neutral)
        if about.unit == "pixel":  # whole pixels are exact
            distance = min(distance, 1.0)
        return math.hypot(self.share * distance, self.of_nothing(about))

    def of_nothing(self, about: Parameter) -> float:
        """Return it where the effect does nothing; 0 for parameters that have no such value, or infinity for it."""
        if about.log or not isinstance(about.neutral, (int, float)):
            return 0.0
        return max(self.steps * about.step, about.inexact)


IDEAL = FormulaError(1e-3, 1e-2)
"""Of a camera whose captures show no errors of a laboratory."""
LABORATORY = FormulaError(2e-2, 1e-1)
"""Of a camera in a laboratory whose exposures or targets have errors: there, the camera's parts have them too."""


def formula_error(fit: Fit) -> FormulaError:
    """Return how far formulas are wrong where the captures of a fit were taken."""
    return LABORATORY if fit.in_laboratory else IDEAL
