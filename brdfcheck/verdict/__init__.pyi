from .checking import assert_conserves as assert_conserves
from .checking import check as check
from .checking import check_family as check_family
from .report import TOLERANCE as TOLERANCE
from .report import Report as Report
from .report import Verdict as Verdict
from .report import judge as judge
