"""Pictures of results; each module imports matplotlib, so import them where a picture is made."""
