from .registry import RULES as RULES
from .rule import AbstractRule as AbstractRule
from .rule import Estimate as Estimate
