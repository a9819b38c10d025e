"""Earliest contact of two bounded bodies, with certificates and their verifier.

The faces take arrays; kernels for balls and hulls stand in `advancement` and `hull_advancement`.
"""

from armguard.contact.certificate import verify
from armguard.contact.earliest import (
    Certificate,
    certify,
    earliest_contact,
    earliest_contact_hull,
    earliest_contact_pair,
)

__all__ = [
    "Certificate",
    "certify",
    "earliest_contact",
    "earliest_contact_hull",
    "earliest_contact_pair",
    "verify",
]
