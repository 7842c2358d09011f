"""Recalibration while the gyroscope measures, by a small sine on V_Vc."""
