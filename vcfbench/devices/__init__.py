"""History of a device: its characteristics, its certificate of K_Vc, and later changes of K_Vc."""
