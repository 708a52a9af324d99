"""The mirror camera and six cameras that a buyer may choose instead, on the same rendered scenes."""
