"""What a study keeps of a result: variables with dimensions, units and labels, by the type of the result."""

from rbd.studies.kept.registry import kept_names

__all__ = ["kept_names"]
