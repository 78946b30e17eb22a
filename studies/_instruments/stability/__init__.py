"""Where methods hold, lose digits, lie or break: rules over a matrix of lobes, exponents, angles, precisions and modes."""

from _instruments.stability.failures import KNOWN_FAILURES as KNOWN_FAILURES
from _instruments.stability.outcomes import NOT_ASKED as NOT_ASKED
from _instruments.stability.outcomes import Gradients as Gradients
from _instruments.stability.outcomes import Outcome as Outcome
from _instruments.stability.outcomes import Result as Result
from _instruments.stability.outcomes import gradient_outcomes as gradient_outcomes
from _instruments.stability.outcomes import gradients_of as gradients_of
from _instruments.stability.outcomes import of_rule as of_rule
from _instruments.stability.outcomes import outcomes as outcomes
from _instruments.stability.outcomes import production as production
from _instruments.stability.outcomes import run as run
from _instruments.stability.references import KINDS as KINDS
from _instruments.stability.references import LOBES as LOBES
from _instruments.stability.references import MICROFACETS as MICROFACETS
from _instruments.stability.references import Reference as Reference
from _instruments.stability.references import read_references as read_references
from _instruments.stability.survey import FOLLOWING as FOLLOWING
from _instruments.stability.survey import SAMPLING as SAMPLING
from _instruments.stability.survey import Job as Job
from _instruments.stability.survey import measured as measured
from _instruments.stability.survey import of_rules as of_rules
from _instruments.stability.verdicts import all_verdicts as all_verdicts
from _instruments.stability.verdicts import false_verdicts as false_verdicts
from _instruments.stability.verdicts import matrix_verdicts as matrix_verdicts
