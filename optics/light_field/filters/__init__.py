"""4-D filters of light fields: hyperfan, dual-fan and hypercone, at the true positions of the views."""

from mirrorcam.optics.light_field.filters.frequency_filter import Filtered, filter_light_field
from mirrorcam.optics.light_field.filters.passband import FilterKind, Passband

__all__ = ["FilterKind", "Filtered", "Passband", "filter_light_field"]
