"""
What rounding does to a mean
============================

A sensor that rounds to steps much coarser than its noise keeps saying the same number: its mean is
wrong by up to half a step, however long one waits. Half a step of noise is enough to cure it.
"""

import matplotlib.pyplot as plt
import numpy as np

from foucault.simulate.noise import quantise

rng = np.random.default_rng(3)
truth = np.linspace(-1, 1, 81)
for noise in (0.05, 0.2, 0.5):
    read = quantise(truth[:, None] + noise * rng.standard_normal((81, 20000)), 1.0)
    plt.plot(truth, read.mean(axis=1) - truth, label=f"noise of {noise:g} steps")
plt.xlabel("true value [steps]")
plt.ylabel("error of the mean [steps]")
plt.legend()
plt.show()
