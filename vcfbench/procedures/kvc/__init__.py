"""The calibration of K_Vc as a curve: the certificate of a device."""
