"""Processes that start with this folder on their path have the toy stage in the house."""

import bakery.stages

bakery.stages.STAGES += ("tests.toy.stage:STAGE",)
