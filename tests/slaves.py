"""An FMU as an importer takes it: instances by FMPy, their values by name, and what they tell."""

import shutil
import tempfile
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


class Slave:
    """An instance of a co-simulation FMU, in its initialization; ``told`` collects its messages."""

    def __init__(self, file: Path | str) -> None:
        self.folder = tempfile.mkdtemp()
        fmpy.extract(str(file), self.folder)
        described = fmpy.read_model_description(str(file))
        self.two = described.fmiVersion == "2.0"
        self.references = {one.name: one.valueReference for one in described.modelVariables}
        self.told: list[str] = []
        self.t_s = 0.0
        self.fmu = (FMU2Slave if self.two else FMU3Slave)(
            guid=described.guid, unzipDirectory=self.folder, modelIdentifier=described.coSimulation.modelIdentifier,
            instanceName="one",
        )  # fmt: skip
        callbacks = fmpy.fmi2.fmi2CallbackFunctions() if self.two else None
        if self.two:
            callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(
                lambda e, n, s, c, text: self.told.append(text.decode())
            )
            callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
            callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
            self.fmu.instantiate(callbacks=callbacks)
            self.fmu.setupExperiment()
        else:
            self.fmu.instantiate(logMessage=lambda e, s, c, text: self.told.append(text.decode()))
        self.fmu.enterInitializationMode()

    def begin(self) -> "Slave":
        """End the initialization."""
        self.fmu.exitInitializationMode()
        return self

    def put(self, **values: float) -> None:
        """Set values; two underscores stand for a dot."""
        names = [name.replace("__", ".") for name in values]
        put = self.fmu.setReal if self.two else self.fmu.setFloat64
        put([self.references[name] for name in names], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Values by name."""
        get = self.fmu.getReal if self.two else self.fmu.getFloat64
        return list(get([self.references[name] for name in names]))

    def step(self, seconds: float = 1e-3) -> None:
        """A communication step from where the last one ended."""
        self.fmu.doStep(self.t_s, seconds)
        self.t_s += seconds

    def close(self) -> None:
        """Free it."""
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)
