# Two commands do everything on a fresh machine: `make bake` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
JOBS ?= 2

# bytecode is kept, whatever is set outside: without it every command compiles anew what it imports
export PYTHONDONTWRITEBYTECODE :=

.PHONY: bake test test-slow setup lint docs bench soak fuzz pictures scenes clean help

help:
	@echo "make bake      set up, bake recipes/fog.yaml, render its preview"
	@echo "make test      set up, run the tests"
	@echo "make test-slow the tests that make test leaves out because quicker ones see most of what they see"
	@echo "make test-blender  renders an exported material in Blender (package bpy, 1 GB, an environment of its own)"
	@echo "make test-eradiate  a layer of an exported medium in Eradiate (an environment of its own)"
	@echo "make recipes   bake every shipped recipe (recipes/Makefile)"
	@echo "make test-pbrt PBRT=…/pbrt  renders an exported medium in pbrt-v4, which you have built"
	@echo "make test-libradtran UVSPEC=…/bin/uvspec  a layer of an exported medium in libRadtran, which you have built"
	@echo "make pictures  bake and draw what the docs show"
	@echo "make scenes    bake and render the scenes of assets/scenes"
	@echo "make gallery   one page of all recipes and scenes with their pictures: build/gallery.html"
	@echo "make figures-goa  measure again what is claimed of geometrical optics (docs/goa-claims.md)"
	@echo "make figures-discrete  the same for pictures of separate particles (docs/discrete-claims.md)"
	@echo "make figures-granular  the same for pictures of packed grains (docs/granular-claims.md)"
	@echo "make figures-translucent  the same for tables of multiple scattering (docs/translucent-claims.md)"
	@echo "make bench     compare with the peers of benchmarks/requirements.txt"
	@echo "make soak      the long tests: kills, damage, fuzzing"
	@echo "make pictures-check  pictures of all scenes against the kept ones, 10 minutes of a core"
	@echo "make fuzz      changed assets given to every command for SECONDS=600"
	@echo "make lint      style"
	@echo "make clean     remove build/ and compiled kernels"
	@echo "make docs      bring the tables of docs/asset-format.md up to date"
	@echo "make site      the documentation as pages, notebooks run: build/site/index.html"
	@echo "make man       man pages of all commands: man -M build/man bake"

bake: $(VENV)/.ready
	@mkdir -p build
	$(BIN)/bake recipes/fog.yaml -o build/fog.h5
	$(BIN)/bake render build/fog.h5 -o build/fog.png
	@echo "asset:    $(CURDIR)/build/fog.h5"
	@echo "preview:  $(CURDIR)/build/fog.png"

# bytecode is kept: the tests start some hundred processes, and without it collection takes 15 s of each core, with it 6 s
test: $(VENV)/.ready-test
	$(BIN)/python -m pytest -q -n $(JOBS) --dist worksteal -m "not slow and not soak" $(PYTEST)

test-slow: $(VENV)/.ready-slow
	$(BIN)/python -m pytest -q -n $(JOBS) --dist worksteal -m slow $(PYTEST)

# bpy has wheels for one version of Python, and wants a NumPy that Bakery does not: tests start it as a process
BLENDER := .venv-blender
BLENDER_PYTHON ?= python3.11
.PHONY: test-blender
test-blender: $(VENV)/.ready-test
	test -x $(BLENDER)/bin/python || $(BLENDER_PYTHON) -m venv $(BLENDER)
	$(BLENDER)/bin/python -m pip install --quiet --disable-pip-version-check 'bpy>=5.0,<5.1'
	BAKERY_BLENDER=$(CURDIR)/$(BLENDER)/bin/python $(BIN)/python -m pytest -q tests/cli/test_export_blender.py

# Eradiate brings a Mitsuba of its own: an environment of its own
ERADIATE := .venv-eradiate
.PHONY: test-eradiate
test-eradiate: $(VENV)/.ready-test
	test -x $(ERADIATE)/bin/python || $(PYTHON) -m venv $(ERADIATE)
	$(ERADIATE)/bin/python -m pip install --quiet --disable-pip-version-check 'eradiate[kernel]>=1.2,<1.3'
	BAKERY_ERADIATE=$(CURDIR)/$(ERADIATE)/bin/python $(BIN)/python -m pytest -q tests/cli/test_export_eradiate.py

# libRadtran has no package: build it from its sources (its data beside bin), then `make test-libradtran UVSPEC=…/bin/uvspec`
UVSPEC ?= uvspec
.PHONY: test-libradtran
test-libradtran: $(VENV)/.ready-test
	@command -v $(UVSPEC) > /dev/null || { echo "no program $(UVSPEC): say where it is, make test-libradtran UVSPEC=…/bin/uvspec"; exit 2; }
	BAKERY_UVSPEC=$$(command -v $(UVSPEC)) $(BIN)/python -m pytest -q tests/cli/test_export_libradtran.py

# pbrt-v4 has no package: build it from its sources, then `make test-pbrt PBRT=…/pbrt`
PBRT ?= pbrt
.PHONY: test-pbrt
test-pbrt: $(VENV)/.ready-test
	@command -v $(PBRT) > /dev/null || { echo "no program $(PBRT): say where it is, make test-pbrt PBRT=…/pbrt"; exit 2; }
	BAKERY_PBRT=$(PBRT) $(BIN)/python -m pytest -q tests/cli/test_export_pbrt.py

soak: $(VENV)/.ready-test
	$(BIN)/python -m pytest -q -m soak --timeout 3600 $(PYTEST)

# ONLY="candle/paths small/glass_ball" takes some of them; what was meant to change is kept anew by the module itself
.PHONY: pictures-check
pictures-check: $(VENV)/.ready-test
	$(BIN)/python -m tests.regression.pictures $(if $(ONLY),--only $(ONLY))

# SEED=1 takes other assets
SECONDS ?= 600
SEED ?= 0
fuzz: $(VENV)/.ready-test
	$(BIN)/python -m tests.robustness.fuzz_assets --seconds $(SECONDS) --seed $(SEED)

setup: $(VENV)/.ready

# the stamps are as new as the last successful install of what pyproject.toml asks for.  Python compiles what it imports when it
# does so first: 3 s of a first bake, where pip takes 13 s for all that there is
$(VENV)/.ready: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[mitsuba,llvm]'
	@touch $@

# all that .ready asks for as well: `make test` installs once.  Bytecode is compiled on all cores, where pip takes one, of what
# the tests import; a few files of packages do not compile by intention
$(VENV)/.ready-test: pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[mitsuba,llvm,test]'
	$(BIN)/python -m compileall -qq -j 0 -x '/(tests|fontTools|lexers|cuda)/' $(VENV)/lib || true
	@touch $(VENV)/.ready $@

# what only slow tests need: the other extras, and a server of objects.  In one call pip would try hundreds of versions of what
# s3fs and moto share
$(VENV)/.ready-slow: $(VENV)/.ready-test
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[mitsuba,llvm,test,store,exchange,solvers,docs]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 's3fs>=2025.3' 'moto[server]>=5.1'
	@touch $@

$(VENV)/.ready-docs: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[mitsuba,llvm,docs]'
	@touch $@

$(VENV)/.ready-bench: $(VENV)/.ready benchmarks/requirements.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r benchmarks/requirements.txt
	@touch $@

bench: $(VENV)/.ready-bench
	for job in mie averages render transport goa packing scatterometer granular granular_render multiple multiple_tables multiple_lookup beam screen; do \
		$(BIN)/python -m benchmarks.$$job || exit 1; done

.PHONY: recipes
recipes: $(VENV)/.ready
	$(MAKE) -C recipes BAKE=$(CURDIR)/$(BIN)/bake OUT=$(CURDIR)/build

pictures: recipes
	$(MAKE) -C recipes BAKE=$(CURDIR)/$(BIN)/bake OUT=$(CURDIR)/build pictures

# QUALITY=final takes the samples that the scenes ask for.  On a slow machine some end by their time before their noise: the picture
# is there all the same, what it misses is told (status 3), and the next scene has its turn; a failure leaves no picture
QUALITY ?= preview
# what their recipes give is baked into the cache
SCENES := $(basename $(notdir $(wildcard assets/scenes/*.yaml)))
scenes: $(VENV)/.ready
	@mkdir -p build
	for scene in $(SCENES); do \
		rm -f build/$$scene.png; \
		$(BIN)/bake render assets/scenes/$$scene.yaml -o build/$$scene.png --quality $(QUALITY) \
			|| { test $$? -eq 3 && test -f build/$$scene.png; } || exit 1; done

# of what `make pictures` and `make scenes` have rendered, or of the pictures of docs/
.PHONY: gallery
gallery: $(VENV)/.ready
	@mkdir -p build
	$(BIN)/python docs/pictures/gallery.py build/gallery.html

# CLAIM="fig6 fig11" makes some of them
.PHONY: figures-goa figures-discrete figures-granular figures-translucent
figures-goa: $(VENV)/.ready
	$(BIN)/python -m benchmarks.figures_goa $(if $(CLAIM),--only $(CLAIM))

figures-discrete: $(VENV)/.ready
	$(BIN)/python -m benchmarks.figures_discrete $(if $(CLAIM),--only $(CLAIM))

figures-granular: $(VENV)/.ready
	$(BIN)/python -m benchmarks.figures_granular $(if $(CLAIM),--only $(CLAIM))

# SIZE=32 is the pictures' width, SHARE=0.2 a fifth of the time
figures-translucent: $(VENV)/.ready
	$(BIN)/python -m benchmarks.figures_translucent $(if $(CLAIM),--only $(CLAIM)) $(if $(SIZE),--size $(SIZE)) \
		$(if $(SHARE),--share $(SHARE))

lint: $(VENV)/.ready-test
	$(BIN)/ruff check bakery renderers tests benchmarks

docs: $(VENV)/.ready
	$(BIN)/python docs/asset_tables.py docs/asset-format.md

# notebooks are run where they, or the sources that they run, have changed
.PHONY: site man
site: $(VENV)/.ready-docs
	$(BIN)/python -m sphinx -W --keep-going -n -q -c docs/site -d build/doctrees . build/site
	@echo "site: $(CURDIR)/build/site/index.html"

man: $(VENV)/.ready
	$(BIN)/python docs/man.py build/man

# compiled kernels too, which are kept by the contents of their sources: those of earlier sources stay until then
clean:
	rm -rf build
	find bakery renderers tests -name '*.nb[ci]' -delete
