"""The table languages that come with the project."""

from vcfbench.models import LANGUAGES
from vcfbench_tables import languages

OF_PLUGIN = (
    *(languages.ZABER, languages.ATL, languages.ESP),
    *(languages.DD16, languages.MN_AS, languages.RUYA, languages.AAAA),
)
DIALECTS = tuple(row.name for row in (*LANGUAGES, *OF_PLUGIN))
SHIPPED = tuple(row.name for row in OF_PLUGIN if row.dialect is None)
"""Those of them that a profile tells."""
