"""Selection of effects.

Modules in order of dependence: ``candidates`` and ``screening`` (linear prediction of gains); ``selection_step``,
``refits``, ``nested_forms``, ``naming`` (obstacles to a name), ``bounds`` and ``validation``; ``forward_selection``,
``pair_screening`` (gains of two effects together), ``robustness`` (smaller models, convergence, equivalent models),
``main_effect`` (rivals of an effect that explains nearly all), ``law_error`` (further effects that may stand for an
error of a law) and ``deviating_specimen``; ``predictive_model`` and ``predictive_selection`` (where the law is
imperfect).
"""
