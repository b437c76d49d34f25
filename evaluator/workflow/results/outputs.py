"""Names of all files in an output folder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Outputs:
    """The files below an output folder."""

    folder: Path

    @property
    def turning(self) -> Path:
        """One row per run: what was measured."""
        return self.folder / "turning.csv"

    @property
    def pooled(self) -> Path:
        """One row per command: its repetitions pooled."""
        return self.folder / "pooled.csv"

    @property
    def directions(self) -> Path:
        """One row per command that was driven both ways: backward against forward."""
        return self.folder / "directions.csv"

    @property
    def comparison(self) -> Path:
        """One row per run: measured beside simulated."""
        return self.folder / "comparison.csv"

    @property
    def provenance(self) -> Path:
        """Versions, settings, hashes of inputs and the command line behind the results."""
        return self.folder / "provenance.json"

    @property
    def report(self) -> Path:
        """The HTML report."""
        return self.folder / "report.html"

    @property
    def diagnosis(self) -> Path:
        """Result of `turnscope diagnose`."""
        return self.folder / "diagnosis.json"

    @property
    def disagreement(self) -> Path:
        """Where measurement and model disagree, a row per second of a run, before and after the diagnosis."""
        return self.folder / "disagreement.csv"

    @property
    def own_effect(self) -> Path:
        """The free-form term that explains most, as the file of a user-defined effect."""
        return self.folder / "own_effect.toml"

    @property
    def own_effects(self) -> tuple[Path, ...]:
        """That file, and those of the other free-form terms of a set, which has four effects at most."""
        return (self.own_effect, *(self.folder / f"own_effect_{number}.toml" for number in (2, 3, 4)))

    @property
    def effects(self) -> Path:
        """User-defined effects of robot_with_effect.toml."""
        return self.folder / "effects"

    @property
    def robot_with_effect(self) -> Path:
        """The robot file with the effects that the diagnosis found."""
        return self.folder / "robot_with_effect.toml"

    @property
    def diagnosis_record(self) -> Path:
        """Hashes of the inputs of the diagnosis; no run id starts like this name."""
        return self.folder / "records" / "_diagnosis.json"

    @property
    def diagnosis_fits(self) -> Path:
        """Fit cache of an unfinished diagnosis; removed when it is complete."""
        return self.folder / "records" / "_diagnosis-fits.jsonl"

    @property
    def experiment(self) -> Path:
        """To which experiment the results belong; no run id starts like this name."""
        return self.folder / "records" / "_experiment.json"

    @property
    def results(self) -> Path:
        """All tables and their provenance, for programs."""
        return self.folder / "results.json"

    def netcdf(self, run: str) -> Path:
        """Marks and poses of a run, for programs that read netCDF."""
        return self.folder / "netcdf" / f"{run}.nc"

    def marks(self, run: str) -> Path:
        """Tracked marks of a run on the plane of the marks."""
        return self.folder / "marks" / f"{run}.csv"

    def poses(self, run: str) -> Path:
        """Centre and heading of a run."""
        return self.folder / "poses" / f"{run}.csv"

    def simulated(self, run: str) -> Path:
        """The simulation of a run."""
        return self.folder / "simulated" / f"{run}.csv"

    def thumbnails(self, run: str) -> Path:
        """A few small frames of a run's video, for the report."""
        return self.folder / "thumbnails" / f"{run}.json"

    def record(self, run: str) -> Path:
        """Hashes of the inputs of each stage of a run, to determine whether it is up to date."""
        return self.folder / "records" / f"{run}.json"

    def of_analysis(self, runs: Iterable[str]) -> Iterator[Path]:
        """All files that an analysis or a comparison of these runs writes or removes."""
        yield from (self.turning, self.pooled, self.directions, self.comparison, self.provenance, self.report)
        yield self.experiment
        for run in runs:
            yield from (self.marks(run), self.poses(run), self.simulated(run), self.thumbnails(run), self.record(run))

    def of_diagnosis(self) -> Iterator[Path]:
        """All files that a diagnosis writes or removes, apart from those of the analysis."""
        yield from (self.diagnosis, self.disagreement, self.robot_with_effect, *self.own_effects)
        yield from (self.diagnosis_record, self.diagnosis_fits, self.experiment)

    def of_export(self, runs: Iterable[str]) -> Iterator[Path]:
        """All files that an export of these runs writes."""
        yield self.results
        yield from map(self.netcdf, runs)
