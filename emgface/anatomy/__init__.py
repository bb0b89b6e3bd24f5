"""Organs beside the face: jaw, hyoid and larynx; airway."""
