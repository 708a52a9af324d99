"""Bundle adjustment of camera, mirrors and board poses: the parameters, residuals with derivatives, and the solver."""
