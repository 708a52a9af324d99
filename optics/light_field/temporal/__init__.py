"""Videos of light fields: filtering in time."""

from mirrorcam.optics.light_field.temporal.filter import TemporalFilter as TemporalFilter
