"""Organs other than the face: jaw, hyoid and larynx; airway."""
