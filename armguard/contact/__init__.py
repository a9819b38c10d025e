"""Earliest contact of two bounded bodies, with certificates and their verifier.

The public functions take arrays; the kernels for balls and hulls are in `advancement` and
`hull_advancement`.
"""

from typing import TYPE_CHECKING

from armguard.lazy import lazy_names

if TYPE_CHECKING:
    from armguard.contact.certificate import verify
    from armguard.contact.earliest import (
        Certificate,
        certify,
        earliest_contact,
        earliest_contact_hull,
        earliest_contact_pair,
    )
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "Certificate": "armguard.contact.earliest",
            "certify": "armguard.contact.earliest",
            "earliest_contact": "armguard.contact.earliest",
            "earliest_contact_hull": "armguard.contact.earliest",
            "earliest_contact_pair": "armguard.contact.earliest",
            "verify": "armguard.contact.certificate",
        },
    )

__all__ = [
    "Certificate",
    "certify",
    "earliest_contact",
    "earliest_contact_hull",
    "earliest_contact_pair",
    "verify",
]
