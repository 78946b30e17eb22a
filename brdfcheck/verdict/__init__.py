"""From a target to a verdict: the search for the largest albedo, the side checks, the report."""

from brdfcheck.verdict.check import TOLERANCE as TOLERANCE
from brdfcheck.verdict.check import Report as Report
from brdfcheck.verdict.check import Verdict as Verdict
from brdfcheck.verdict.check import assert_conserves as assert_conserves
from brdfcheck.verdict.check import check as check
from brdfcheck.verdict.check import check_family as check_family
from brdfcheck.verdict.check import judge as judge
