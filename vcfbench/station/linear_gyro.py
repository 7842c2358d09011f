"""A gyroscope on paper: a straight line that answers the steps of a plan without a bench."""

from collections.abc import Mapping, Sequence

from msgspec import Struct


class LinearGyro(Struct):
    """Predicts every step for a gyroscope with a straight line and the expected K_Vc.

    `k_vc` is in (deg/s)/V, `scale_factor` in V/(deg/s), `bias_v` in V. `v_vc_v` and `v_vc_on` are what the plan has set
    so far.
    """

    k_vc: float
    scale_factor: float = -0.0125
    bias_v: float = 0.0
    v_vc_v: float = 0.0
    v_vc_on: bool = False

    def output_v(self, table_deg_s: float) -> float:
        """Return the output with the table at `table_deg_s`, V."""
        rate_deg_s = table_deg_s + (self.k_vc * self.v_vc_v if self.v_vc_on else 0.0)
        return self.bias_v + self.scale_factor * rate_deg_s

    def noise_v(self, after_s: float) -> float:
        """Return the noise of one reading, V: zero, because this gyroscope has no noise."""
        return 0.0

    def record_noise_v(self, count: int, interval_s: float, aperture_s: float) -> Sequence[float]:
        """Return the noise of `count` readings, V, one every `interval_s`, each over `aperture_s`; none here."""
        return (0.0,) * count

    def of_device(self, name: str) -> "LinearGyro":
        """Return that of one of several devices; all are alike."""
        return self


class LinearGyros(LinearGyro, kw_only=True):
    """The gyroscopes on paper of several devices, `of` their names; all that is common is as of the first."""

    of: Mapping[str, LinearGyro]

    @classmethod
    def together(cls, of: Mapping[str, LinearGyro]) -> "LinearGyros":
        """Return several."""
        first = next(iter(of.values()))
        return cls(first.k_vc, first.scale_factor, first.bias_v, of=of)

    def of_device(self, name: str) -> LinearGyro:
        """Return that of one of them."""
        return self.of[name]
