"""Adapters (`Back`) under the mount's foot that support the device on a desk, a tripod, an arm or a profile.

`plan_backs.plan_back` plans any kind as a `Back`, selected by its table of dimensions. The rest of `cad` uses the
`Back` and does not depend on its kind.
"""
