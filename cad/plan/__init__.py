"""Numbers that parts are drawn from, without a CAD kernel."""
