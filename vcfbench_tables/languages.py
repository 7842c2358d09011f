"""Rows of the table languages of this package; the tables that speak them in a simulation are the rack's."""

from typing import Final

from vcfbench.models import TableLanguage

ZABER: Final = TableLanguage(
    "zaber",
    twin="simrack.rate_tables.zaber:ZaberTable",
    dialect="vcfbench_tables.zaber:ZaberDialect",
    baud_rate=115_200,
)
ATL: Final = TableLanguage("atl", twin="simrack.rate_tables.atl:AtlTable", dialect="vcfbench_tables.atl:AtlDialect")
ESP: Final = TableLanguage(
    "esp",
    twin="simrack.rate_tables.esp:EspTable",
    dialect="vcfbench_tables.esp:EspDialect",
    baud_rate=19_200,  # unverified
)
DD16: Final = TableLanguage("dd16", twin="simrack.rate_tables.dd16:Dd16Table")
MN_AS: Final = TableLanguage("mn_as", twin="simrack.rate_tables.mn_as:MnAsTable")
RUYA: Final = TableLanguage(
    "ruya",
    twin="simrack.rate_tables.ruya:RuyaTable",
    own_watchdog="it has none: a rate run goes on when the program has ended",
)
AAAA: Final = TableLanguage("aaaa", twin="simrack.rate_tables.aaaa:AaaaTable")
