"""Data sheets by model: those that the simulated instruments are drawn from, for budgets and limits."""

from simrack.specifications import AC_VOLTS_U as AC_VOLTS_U
from simrack.specifications import AGILENT_33220A as AGILENT_33220A
from simrack.specifications import HP_34401A as HP_34401A
from simrack.specifications import KEITHLEY_2000 as KEITHLEY_2000
from simrack.specifications import KEITHLEY_DMM6500 as KEITHLEY_DMM6500
from simrack.specifications import KEYSIGHT_33500B as KEYSIGHT_33500B
from simrack.specifications import KEYSIGHT_34461A as KEYSIGHT_34461A
from simrack.specifications import KEYSIGHT_34465A as KEYSIGHT_34465A
from simrack.specifications import KEYSIGHT_E3631A as KEYSIGHT_E3631A
from simrack.specifications import KEYSIGHT_E36312A as KEYSIGHT_E36312A
from simrack.specifications import ROOM_C as ROOM_C
from simrack.specifications import TEMPERATURE_COEFFICIENTS as TEMPERATURE_COEFFICIENTS
from simrack.specifications import WORST_OF_CLASS as WORST_OF_CLASS
from simrack.specifications import Accuracy as Accuracy
from simrack.specifications import Assumed as Assumed
from simrack.specifications import LevelSpecification as LevelSpecification
from simrack.specifications import SupplySpecification as SupplySpecification
from simrack.specifications import VoltmeterSpecification as VoltmeterSpecification
from simrack.specifications import accuracy_at as accuracy_at
