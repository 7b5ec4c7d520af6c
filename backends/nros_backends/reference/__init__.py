"""The reference: the model of `nros_conformance.model` behind the contract, on a virtual clock.

It is the yardstick of the tests and the control of every run, and has no row in the matrix.
"""

from nros_backends.reference.backend import ReferenceBackend

__all__ = ["ReferenceBackend"]
