"""A voltmeter that does not exist, as a package of its own; `MODEL` is how vcfbench knows it."""

from vcfbench.models import Model

MODEL = Model(
    "M1",
    ("multimeter",),
    driver="acme.driver:M1",
    twin="acme.twin:SimulatedM1",
    makers=("ACME",),
    specifications="acme.sheet:M1",
    answers={"*IDN?": "ACME,M1,0042,1.0"},
)
