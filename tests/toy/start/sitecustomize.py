"""Processes that start with this folder on their path have the toy stage registered."""

import bakery.stages

bakery.stages.STAGES += ("tests.toy.stage:STAGE",)
