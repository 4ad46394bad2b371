"""`make bench`: the learner beside its peers on all four tasks."""

from benchmarks.learner_speed import main

main()
