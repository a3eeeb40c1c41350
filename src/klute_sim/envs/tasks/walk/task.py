"""Observations, reward and termination of many persons who walk with a prosthesis.

Every quantity is an array with one entry per person, so a single environment and a batch share this code.
"""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.envs.base.task import BatchStep
from klute_sim.envs.tasks.instruments import N_MEASURED, NOISE_DEVIATION, NoisyMeasurements, build_observations
from klute_sim.envs.tasks.reward import resolve_weights
from klute_sim.envs.tasks.walk.options import N_GROUNDS, WalkTaskOptions
from klute_sim.envs.tasks.walk.person import ActionController, WalkingPerson, stack_body_states
from klute_sim.envs.tasks.walk.reward import DEFAULT_WEIGHTS, REWARD_TERMS, compute_terms
from klute_sim.types import Array, Mask
from klute_sim.units import BAR
from klute_sim.walker.person.body import load_body
from klute_sim.walker.person.build import Ground, build_walker_model, get_contact
from klute_sim.walker.reflexes.walker_file import load_walker
from klute_sim.walker.simulation.simulate import select_adapted_walkers
from klute_sim.walker.simulation.simulator import WalkSimulator

Rngs = Sequence[np.random.Generator]


class WalkTask:
    """Sampling, observation and evaluation of ``n_people`` persons."""

    def __init__(self, options: WalkTaskOptions, n_people: int, backend: str) -> None:
        """Set up the task with a ``backend``, ``compiled`` or ``python``.

        Raises InputError when a walker does not fit.
        """
        self._options, self._backend, self._body = options, backend, load_body()
        self._models: dict[int, mujoco.MjModel] = {}
        model = self.get_model(0)
        chosen = options.walkers
        self.walkers = select_adapted_walkers(options.prosthesis) if chosen is None else list(map(load_walker, chosen))
        """Walkers from which an episode samples one."""
        for walker in self.walkers:
            walker.check_legs(is_intact=False)
            walker.check_fits(self._body, get_contact(model))
        self._people: list[WalkingPerson | None] = [None] * n_people
        self._weights = resolve_weights(options.reward, DEFAULT_WEIGHTS)
        noise = options.sensor_noise * np.append(NOISE_DEVIATION, 0.0)  # the phase follows from the load cell at 1 kHz
        self._measurements = NoisyMeasurements(n_people, noise, options.sensor_delay)
        self.elapsed_intervals = np.zeros(n_people, dtype=np.int64)
        """Number of intervals since the reset."""
        self._previous_action = np.zeros(n_people)

    def get_model(self, ground_seed: int) -> mujoco.MjModel:
        """Return the model with the ground of ``ground_seed``, which is built once."""
        if ground_seed not in self._models:
            # As long as a person comes who walks faster than any walker.
            length = 2.0 * self._options.duration + 5.0
            ground = Ground(unevenness=self._options.unevenness, seed=ground_seed, length=length)
            self._models[ground_seed] = build_walker_model(
                self._body, self._options.prosthesis, dt=self._options.time_step, ground=ground
            )
        return self._models[ground_seed]

    def get_person(self, index: int) -> WalkingPerson:
        """Return person ``index``, whose episode has started."""
        person = self._people[index]
        assert person is not None
        return person

    @property
    def observations(self) -> NDArray[np.float32]:
        """Return the observations (n, 8) of the prostheses; see :mod:`klute_sim.envs.tasks.instruments`."""
        values = self._measurements.values
        return build_observations(values[:, :N_MEASURED], values[:, N_MEASURED])

    def start_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        """Sample walker, gains and ground of person ``index``; call inside ``device_callbacks``."""
        options, sampled = self._options, {}
        walker_index = int(rng.integers(len(self.walkers))) if len(self.walkers) > 1 else 0
        sampled["walker_index"] = float(walker_index)
        ground_seed = 0
        if options.unevenness > 0.0:
            ground_seed = int(rng.integers(N_GROUNDS))
            sampled["ground_seed"] = float(ground_seed)
        model, person = self.get_model(ground_seed), self._people[index]
        if person is None or person.simulator.model is not model:
            person = self._people[index] = self._create_person(model)
        person.start(self.walkers[walker_index].reflexes.perturb(options.gain_noise, rng))
        return sampled

    def _create_person(self, model: mujoco.MjModel) -> WalkingPerson:
        options = self._options
        simulator = WalkSimulator(model, self._body, backend=self._backend)
        controller = None
        if options.has_device:
            controller = ActionController(
                options.base if options.action == "residual" else None,
                options.residual_bar * BAR,
                options.prosthesis.device.parameters.supply.max_pressure,
            )
        return WalkingPerson(simulator, controller, options.actions_per_episode, options.speed)

    def reset(self, mask: Mask, rngs: Rngs) -> None:
        """Reset the observations of the persons in ``mask``, whose episodes have started."""
        self.elapsed_intervals[mask] = 0
        self._measurements.reset(mask, self._read_sensors(mask), rngs)
        max_pressure = self._options.prosthesis.device.parameters.supply.max_pressure / BAR
        for i in np.flatnonzero(mask).tolist():
            holding = 2.0 * self.get_person(i).pressure / max_pressure - 1.0
            self._previous_action[i] = holding if self._options.action == "pressure" else 0.0

    def set_actions(self, actions: Array, mask: Mask) -> None:
        """Set the actions (n,) of the persons in ``mask``; values beyond -1 and 1 are clipped."""
        clipped = np.clip(actions, -1.0, 1.0).tolist()
        for i in np.flatnonzero(mask).tolist():
            self.get_person(i).set_action(clipped[i], self._measurements.values[i])

    def evaluate(self, actions: Array, mask: Mask, rngs: Rngs) -> BatchStep:
        """Return the result of the interval with ``actions`` (n,) that ends now; only persons in ``mask`` advance."""
        self.elapsed_intervals += mask
        self._measurements.update(mask, self._read_sensors(mask), rngs)
        people = [self.get_person(i) for i in range(len(mask))]
        actions = np.clip(actions, -1.0, 1.0)
        has_fallen: Mask = np.array([not person.is_walking for person in people]) & mask
        info = stack_body_states(people)
        terms = self._weights * compute_terms(
            has_fallen.astype(np.float64),
            info["metabolic_cost_j_per_kg_m"],
            info["speed_m_per_s"] - self._options.speed,
            info["step_asymmetry"],
            actions - self._previous_action,
        )
        terms[~mask] = 0.0
        self._previous_action = np.where(mask, actions, self._previous_action)
        truncated = (self.elapsed_intervals >= self._options.actions_per_episode) & mask & ~has_fallen
        info["pressure_command_bar"] = np.array([person.command for person in people])
        term_info = dict(zip(REWARD_TERMS, terms.T, strict=True))
        return BatchStep(terms.sum(axis=1), has_fallen, truncated, term_info | info)

    def _read_sensors(self, mask: Mask) -> Array:
        """Return the ideal measurements (n, 7): those of the observations, and the phase; 0 outside ``mask``."""
        measured = np.zeros((len(mask), N_MEASURED + 1))
        for i in np.flatnonzero(mask).tolist():
            measured[i] = self.get_person(i).read_sensors()
        return measured
