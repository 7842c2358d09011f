"""The table languages that come with the project."""

from vcfbench.models import LANGUAGES

DIALECTS = tuple(row.name for row in LANGUAGES)
SHIPPED = tuple(row.name for row in LANGUAGES if row.dialect is None)
"""Those of them that a profile tells."""
