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
        return {key: found.missing for key, found in self.judged().items() if isinstance(found, Measurand)}
