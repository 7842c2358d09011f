"""Recalibration without a table, by V_Vc and the device's certificate."""
