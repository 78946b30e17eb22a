"""Reports as a page: one file that needs nothing else, asks no network for anything, and runs no script but its own."""

from brdfcheck.output.html.page import Entry as Entry
from brdfcheck.output.html.page import heading as heading
from brdfcheck.output.html.page import page as page
