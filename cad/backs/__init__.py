"""Backs: what is screwed under the mount's foot, and carries the device on a desk, a tripod, an arm, a profile.

Each kind is planned into the one type `Back`; `plan_backs.plan_back` chooses by the table of dimensions. The rest of
`cad` reads the `Back`, and knows no kinds.
"""
