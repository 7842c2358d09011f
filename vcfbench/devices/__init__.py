"""A device as earlier runs know it: its characteristics, its certificate of K_Vc, and what changes K_Vc since."""
