"""The data sheet of the ACME M1, which does not exist either."""

from vcfbench.specifications import Accuracy, VoltmeterSpecification

M1 = VoltmeterSpecification(
    model="M1",
    accuracy={100.0: {365: Accuracy(reading=1e-4, range=1e-5)}},
    resolution={1.0: 1e-6, 10.0: 1e-6},  # it integrates for as long whatever it is asked for
    accuracy_source="manual p. 31",
    resolution_source="manual p. 30",
)
