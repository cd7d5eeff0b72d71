"""Diagnosis of the gap between simulation and rig: size, location, causes, probabilities, reduction.

Reading order. `diagnose.diagnose` runs the stages; each stage extends the frozen record of `state`. The modules named
here contain about 21,000 words of text and code, and can be read in about an hour and a half. The other modules of
these folders contain about 60,000 words. The docstring of each module states its purpose.

    stage (reported as)        entry point                       question
    screen                     screen.record.record              which readings are faulty?
    bare model                 bare_model.fit_bare_model         what remains without effects?
    where                      where.locate.locate               at which angle, speed or time does it remain?
    which                      which.select.forward, refined     which set of effects explains it?
                               corrections.CORRECTIONS           does it show that recordings need a correction?
    classes                    classes.posterior.effect_posterior  which effects are indistinguishable, how probable?
    transfer                   transfer.transfer.transfer        does the set predict recordings that were not fitted?
    advice                     advice.advise.advise              which check separates the alternatives?
    evidence                   evidence.evidence.evidence        what supports the result?
    conclusion                 conclusion.conclusion.conclude    verdict, intervals, assumptions

1. `hypothesis.hypothesis`: a set of effects with its fit; `hypothesis.score_test`: the predicted reduction of chi2 by
   one more effect. Both are linear algebra on `dpr_lab.fitting.linearise`.
2. `which.search`: a `Move` proposes and accepts sets; `which.moves` lists all moves in their order;
   `which.fitted_sets` fits each set once, with measures against local minima.
3. `hypothesis.thresholds`: every threshold of an acceptance, with its origin.
4. `damage.disturbances`: readings that are disturbed by kicks, hands or steps are excluded: after the bare model and,
   by `corrections`, after forward selection.

Recordings that are not fitted are called held out. `Request.held_out` contains these runs, `state.held_out` the
screened runs. `state.held_out_prediction` predicts them by any set of effects.

docs/how-the-diagnosis-decides.md explains the decisions; docs/theory.md, sections 5 and 7 to 10, contains the
equations.
"""
