# Two commands do everything: `make demo` and `make test`. Each makes .venv by itself and installs the built wheel.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
SOURCES := pyproject.toml constraints.txt README.md LICENSE $(shell find lgprjax data_schema onboard sites tuning -type f -not -name '*.pyc')

# gprMax (GPL) is an outside program in an environment of its own. Its wheels are for Python 3.11 to 3.13.
GPRMAX := .venv-gprmax

.PHONY: demo test lint types docs pictures validation campaign coverage gprmax mutants clean

demo: $(VENV)/.wheel
	$(BIN)/lgprjax demo --output out/demo

# A file stays in one process, whose fixtures its tests share. Compiled programs are kept where the commands keep theirs:
# the next run, another clone and the commands need not compile them again.
export LGPRJAX_TEST_CACHE ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/lgprjax/compiled
test: $(VENV)/.test
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

# Evidence that takes longer than the suite; all of it without NAME. Interrupted, it goes on where it was.
validation campaign: $(VENV)/.test
	$(BIN)/python -m validation $(NAME)

gprmax: $(VENV)/.test $(GPRMAX)/.gprmax
	LGPRJAX_GPRMAX=$(CURDIR)/$(GPRMAX)/bin/python $(MAKE) validation NAME=full_wave

# Every mutant of the command limiter must be killed, and of the manoeuvres' programmes all but equivalent ones. The tool
# changes files in place, hence the copy.
mutants: $(VENV)/.test
	$(PIP) install --constraint constraints.txt cosmic-ray
	rm -rf build/mutants && mkdir -p build/mutants/tests/autopilot build/mutants/tests/runtime
	cp -r lgprjax build/mutants/ && cp tests/pedalled_plant.py build/mutants/tests/
	cp tests/autopilot/test_limiter.py tests/autopilot/test_skid_limiter.py build/mutants/tests/autopilot/
	cp tests/runtime/test_manoeuvre_programs.py build/mutants/tests/runtime/
	cd build/mutants && PATH="$(CURDIR)/$(BIN):$$PATH" PYTHONPATH=.:tests && export PATH PYTHONPATH \
	&& for each in autopilot:0 runtime:7; do room=$${each%:*}; \
	     cosmic-ray init $(CURDIR)/tests/$$room/mutants.toml $$room.sqlite \
	     && cosmic-ray exec $(CURDIR)/tests/$$room/mutants.toml $$room.sqlite \
	     && cr-report $$room.sqlite | tail -3 && cr-rate --fail-over $${each#*:} $$room.sqlite || exit 1; \
	   done

# Branches of the numeric rooms, by their own tests and by those that drive them as a whole. A quarter of an hour.
ROOMS := autopilot coverage navigation pso radar registration scene subsurface vehicle
coverage: $(VENV)/.test
	$(PIP) install --constraint constraints.txt coverage
	mkdir -p build
	$(BIN)/coverage run --branch --data-file=build/coverage \
	  --include="$$(printf '*/lgprjax/%s/*,' $(ROOMS))" -m pytest -q -m 'long or not long' $(addprefix tests/,$(ROOMS)) tests/batch tests/mapping \
	  tests/simulation tests/runtime/test_on_board.py tests/runtime/test_field.py
	$(BIN)/coverage report --data-file=build/coverage --skip-covered --sort=cover --fail-under=95

lint: $(VENV)/.lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.lint $(VENV)/.test
	$(BIN)/mypy

# Any warning ends it. The site needs nothing from outside, neither now nor when it is read.
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "site: build/site/index.html"

# Every picture of docs/pictures with fixed seeds; NAME chooses some. Radargrams of real ground need LGPRJAX_REAL_DATA.
pictures: $(VENV)/.test
	$(BIN)/python -m pictures $(NAME)

$(VENV)/.venv:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(v < (3, 11) and f"Python 3.11 or newer is needed, this is {v[0]}.{v[1]}: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	@touch $@

# The wheel is built and installed, never the source tree: what is tested is what a user gets.
$(VENV)/.wheel: $(VENV)/.venv $(SOURCES)
	@echo "installing lgprjax (the first time fetches its dependencies)"
	@rm -rf build/wheel
	PIP_CONSTRAINT=constraints.txt $(PIP) wheel --no-deps --wheel-dir build/wheel .
	$(PIP) install --constraint constraints.txt "lgprjax[onboard,log] @ file://$(CURDIR)/$$(ls build/wheel/lgprjax-*.whl)"
	$(PIP) install --no-deps --force-reinstall build/wheel/lgprjax-*.whl
	@touch $@

$(VENV)/.test: $(VENV)/.wheel
	$(PIP) install --constraint constraints.txt "lgprjax[test,docs] @ file://$(CURDIR)/$$(ls build/wheel/lgprjax-*.whl)"
	@touch $@

$(VENV)/.lint: $(VENV)/.wheel
	$(PIP) install --constraint constraints.txt "lgprjax[lint] @ file://$(CURDIR)/$$(ls build/wheel/lgprjax-*.whl)"
	@touch $@

$(VENV)/.docs: $(VENV)/.wheel
	$(PIP) install --constraint constraints.txt "lgprjax[docs] @ file://$(CURDIR)/$$(ls build/wheel/lgprjax-*.whl)"
	@touch $@

$(GPRMAX)/.gprmax:
	$(PYTHON) -m venv $(GPRMAX)
	$(GPRMAX)/bin/python -m pip --disable-pip-version-check --quiet install gprmax==4.0.1
	@touch $@

clean:
	rm -rf $(VENV) $(GPRMAX) build dist out
