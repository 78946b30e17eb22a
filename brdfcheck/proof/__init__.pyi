from .certificate import Certificate as Certificate
from .certify import certify as certify
from .cover import NotProved as NotProved
from .verify import Rejected as Rejected
from .verify import read as read
from .verify import verify as verify
