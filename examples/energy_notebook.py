# %% [markdown]
# # The energy of a swarm
# This notebook simulates one mission, and shows it as arrays and as a data frame. Run it as a script, or cell by cell
# in an editor that knows `# %%`. It needs the extras "plots" and "frames".
#
#     python examples/energy_notebook.py [PICTURE.png]

# %%
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib import pyplot as plt

from edc_swarm.analysis.columns import columns_of
from edc_swarm.analysis.energy_bill import energy_bills
from edc_swarm.analysis.frames import frame_of
from edc_swarm.analysis.metrics import compute_metrics
from edc_swarm.analysis.timings import load_timings
from edc_swarm.emulation.energy import propulsion_power_w
from edc_swarm.recording.reader import read_recording
from processes.cli.main import main

# %% Simulate twenty UAVs, and read the recording. Any other recording works too.
with TemporaryDirectory() as folder:
    path = Path(folder) / "mission.mcap"
    main(["sim", "--uavs", "20", "--seed", "3", "--out", str(path)])
    recording, timings = read_recording(path), load_timings(path)

# %% The energy relative to the straight-line bound, and the detour, which explains only a part of the difference.
metrics, columns = compute_metrics(recording, timings), columns_of(recording, timings)
assert metrics.energy_propulsion_j is not None  # it is None if the recording lacks messages
assert metrics.energy_straight_j is not None
energy_pct = 100 * (metrics.energy_propulsion_j / metrics.energy_straight_j - 1)
print(f"energy {energy_pct:.1f} % and distance {metrics.extra_distance_pct:.1f} % above the straight lines")

# %% The energy bill of each UAV.
for bill in energy_bills(recording, timings)[:5]:
    parts_j = {"cruise": bill.cruise_j, "hover": bill.hover_j, "radio": bill.radio_j}
    print(f"{bill.uav}: " + ", ".join(f"{name} {'-' if j is None else f'{j:.2f} J'}" for name, j in parts_j.items()))

# %% One row per UAV and slot: mean speed of the UAVs that are still under way.
frame = frame_of(columns, "pandas")
speed_mps = frame[frame.away_m > 0.1].groupby("time_s").step_m.mean() / recording.mission.dt_s

# %% Power of the whole swarm over time.
power_kw = [
    sum(propulsion_power_w(step_m / recording.mission.dt_s, recording.mission.energy) for step_m in steps_m) / 1e3
    for steps_m in columns.step_m
]
figure, (above, below) = plt.subplots(2, 1, sharex=True, layout="constrained")
above.plot(columns.time_s, power_kw)
above.set_ylabel("Propulsion power [kW]")
below.plot(speed_mps.index, speed_mps)
below.set_ylabel("Mean speed under way [m/s]")
below.set_xlabel("Mission time [s]")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "energy.png", dpi=150)
