"""Results as ``[acceptance]`` of the bench file judges them."""

from collections.abc import Mapping

from msgspec import Struct

from vcfbench.procedures.shared.measurand import Measurand


class Judged(Struct, frozen=True):
    """Results of which ``[acceptance]`` judges values that have an uncertainty, and others."""

    def judged(self) -> Mapping[str, Measurand | float]:
        """Return the judged values, by their keys."""
        raise NotImplementedError

    def acceptance_values(self) -> Mapping[str, float | None]:
        return {key: found.value if isinstance(found, Measurand) else found for key, found in self.judged().items()}

    def acceptance_u95(self) -> Mapping[str, float]:
        return {key: found.expanded_u for key, found in self.judged().items() if isinstance(found, Measurand)}

    def acceptance_missing(self) -> Mapping[str, tuple[str, ...]]:
        found = self.judged()
        of_drift = getattr(found.get("drift_ppm"), "missing", ())  # an E_n is by the U95 of the drift
        own = {key: each.missing for key, each in found.items() if isinstance(each, Measurand)}
        return {**{key: of_drift for key in found if key.startswith("e_n")}, **own}
