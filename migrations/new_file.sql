CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);

CREATE TABLE solutions (
	id CHAR(32) NOT NULL, 
	job_id CHAR(32) NOT NULL, 
	digest VARCHAR(64) NOT NULL, 
	problem JSON NOT NULL, 
	summary JSON NOT NULL, 
	created_at DOUBLE NOT NULL, 
	family VARCHAR(32), 
	method VARCHAR(32), 
	tier VARCHAR(32), 
	"A" DOUBLE, 
	"C" DOUBLE, 
	period DOUBLE, 
	energy DOUBLE, 
	error DOUBLE, "B" DOUBLE, lambda_ DOUBLE, drift DOUBLE, trace DOUBLE, seconds DOUBLE, stability VARCHAR(16), aperiodic VARCHAR(16), facts JSON, note VARCHAR(2000), 
	CONSTRAINT pk_solutions PRIMARY KEY (id), 
	CONSTRAINT uq_solutions_job_id UNIQUE (job_id)
);

CREATE INDEX ix_solutions_digest ON solutions (digest);

CREATE TABLE dense_outputs (
	solution_id CHAR(32) NOT NULL, 
	data BLOB NOT NULL, 
	CONSTRAINT pk_dense_outputs PRIMARY KEY (solution_id), 
	CONSTRAINT fk_dense_outputs_solution_id FOREIGN KEY(solution_id) REFERENCES solutions (id) ON DELETE CASCADE
);

CREATE TABLE samples (
	solution_id CHAR(32) NOT NULL, 
	data BLOB NOT NULL, 
	CONSTRAINT pk_samples PRIMARY KEY (solution_id), 
	CONSTRAINT fk_samples_solution_id FOREIGN KEY(solution_id) REFERENCES solutions (id) ON DELETE CASCADE
);

CREATE TABLE attempts (
	job_id CHAR(32) NOT NULL, 
	number INTEGER NOT NULL, 
	worker VARCHAR(128) NOT NULL, 
	started_at DOUBLE NOT NULL, 
	ended_at DOUBLE, 
	outcome VARCHAR(16), 
	detail VARCHAR(512), 
	CONSTRAINT pk_attempts PRIMARY KEY (job_id, number), 
	CONSTRAINT ck_attempts_outcome CHECK (outcome IN ('succeeded', 'failed', 'lost', 'returned', 'cancelled')), 
	CONSTRAINT fk_attempts_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);

CREATE TABLE calibrations (
	id CHAR(32) NOT NULL, 
	created_at DOUBLE NOT NULL, 
	document JSON NOT NULL, 
	CONSTRAINT pk_calibrations PRIMARY KEY (id)
);

CREATE INDEX ix_calibrations_created_at ON calibrations (created_at);

CREATE TABLE sweeps (
	id CHAR(32) NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	document JSON NOT NULL, 
	points BIGINT NOT NULL, 
	next_index BIGINT NOT NULL, 
	done BIGINT NOT NULL, 
	refused BIGINT NOT NULL, 
	chunk_points INTEGER NOT NULL, 
	point_seconds DOUBLE, 
	priority INTEGER NOT NULL, 
	key_id CHAR(32), 
	error JSON, 
	created_at DOUBLE NOT NULL, 
	started_at DOUBLE, 
	finished_at DOUBLE, facts JSON, note VARCHAR(2000), changed_at DOUBLE DEFAULT '0' NOT NULL, way VARCHAR(16), 
	CONSTRAINT pk_sweeps PRIMARY KEY (id), 
	CONSTRAINT ck_sweeps_state CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')), 
	CONSTRAINT ck_sweeps_progress CHECK (done <= next_index AND next_index <= points), 
	CONSTRAINT ck_sweeps_refused CHECK (refused <= done)
);

CREATE INDEX ix_sweeps_state_id ON sweeps (state, id);

CREATE INDEX ix_sweeps_key_id ON sweeps (key_id);

CREATE TABLE sweep_chunks (
	sweep_id CHAR(32) NOT NULL, 
	first BIGINT NOT NULL, 
	count INTEGER NOT NULL, 
	refused INTEGER NOT NULL, 
	bounds JSON NOT NULL, 
	data BLOB NOT NULL, 
	CONSTRAINT pk_sweep_chunks PRIMARY KEY (sweep_id, first), 
	CONSTRAINT ck_sweep_chunks_count CHECK (count > 0 AND refused <= count), 
	CONSTRAINT fk_sweep_chunks_sweep_id FOREIGN KEY(sweep_id) REFERENCES sweeps (id) ON DELETE CASCADE
);

CREATE TABLE api_keys (
	id CHAR(32) NOT NULL, 
	prefix VARCHAR(32) NOT NULL, 
	hash BLOB NOT NULL, 
	name VARCHAR(128) NOT NULL, 
	role VARCHAR(16) NOT NULL, 
	created_at DOUBLE NOT NULL, 
	expires_at DOUBLE, 
	revoked_at DOUBLE, 
	last_used_at DOUBLE, 
	requests_per_second DOUBLE, 
	max_queued_jobs INTEGER, 
	max_stored_bytes BIGINT, 
	stored_bytes BIGINT NOT NULL, 
	CONSTRAINT pk_api_keys PRIMARY KEY (id), 
	CONSTRAINT ck_api_keys_role CHECK (role IN ('read', 'submit', 'operate', 'admin')), 
	CONSTRAINT uq_api_keys_prefix UNIQUE (prefix)
);

CREATE TABLE workers (
	name VARCHAR(128) NOT NULL, 
	host VARCHAR(255) NOT NULL, 
	engine VARCHAR(32) NOT NULL, 
	slots INTEGER NOT NULL, 
	started_at DOUBLE NOT NULL, 
	seen_at DOUBLE NOT NULL, is_warm BOOLEAN DEFAULT 1 NOT NULL, kernels JSON, 
	CONSTRAINT pk_workers PRIMARY KEY (name)
);

CREATE INDEX ix_attempts_ended_at ON attempts (ended_at);

CREATE TABLE examinations (
	"key" VARCHAR(64) NOT NULL, 
	version VARCHAR(128) NOT NULL, 
	content BLOB NOT NULL, 
	seal VARCHAR(64) NOT NULL, 
	used_at DOUBLE NOT NULL, 
	CONSTRAINT pk_examinations PRIMARY KEY ("key")
);

CREATE INDEX ix_examinations_used_at ON examinations (used_at);

CREATE TABLE idempotency_keys (
	principal VARCHAR(64) NOT NULL, 
	"key" VARCHAR(255) NOT NULL, 
	fingerprint VARCHAR(64) NOT NULL, 
	status INTEGER NOT NULL, 
	headers JSON NOT NULL, 
	body BLOB NOT NULL, 
	created_at DOUBLE NOT NULL, 
	CONSTRAINT pk_idempotency_keys PRIMARY KEY (principal, "key")
);

CREATE INDEX ix_idempotency_keys_created_at ON idempotency_keys (created_at);

CREATE TABLE job_labels (
	job_id CHAR(32) NOT NULL, 
	"key" VARCHAR(63) NOT NULL, 
	value VARCHAR(128) NOT NULL, 
	created_at DOUBLE NOT NULL, 
	CONSTRAINT pk_job_labels PRIMARY KEY (job_id, "key"), 
	CONSTRAINT fk_job_labels_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);

CREATE INDEX ix_job_labels_key_value ON job_labels ("key", value, created_at, job_id);

CREATE INDEX ix_job_labels_key_value_id ON job_labels ("key", value, job_id);

CREATE TABLE solution_labels (
	solution_id CHAR(32) NOT NULL, 
	"key" VARCHAR(63) NOT NULL, 
	value VARCHAR(128) NOT NULL, 
	created_at DOUBLE NOT NULL, 
	CONSTRAINT pk_solution_labels PRIMARY KEY (solution_id, "key"), 
	CONSTRAINT fk_solution_labels_solution_id FOREIGN KEY(solution_id) REFERENCES solutions (id) ON DELETE CASCADE
);

CREATE INDEX ix_solution_labels_key_value ON solution_labels ("key", value, created_at, solution_id);

CREATE INDEX ix_solution_labels_key_value_id ON solution_labels ("key", value, solution_id);

CREATE TABLE sweep_labels (
	sweep_id CHAR(32) NOT NULL, 
	"key" VARCHAR(63) NOT NULL, 
	value VARCHAR(128) NOT NULL, 
	created_at DOUBLE NOT NULL, 
	CONSTRAINT pk_sweep_labels PRIMARY KEY (sweep_id, "key"), 
	CONSTRAINT fk_sweep_labels_sweep_id FOREIGN KEY(sweep_id) REFERENCES sweeps (id) ON DELETE CASCADE
);

CREATE INDEX ix_sweep_labels_key_value ON sweep_labels ("key", value, created_at, sweep_id);

CREATE INDEX ix_sweep_labels_key_value_id ON sweep_labels ("key", value, sweep_id);

CREATE INDEX ix_sweeps_changed ON sweeps (changed_at, id);

CREATE TABLE audits (
	job_id CHAR(32) NOT NULL, 
	solution_id CHAR(32) NOT NULL, 
	comparison JSON, 
	CONSTRAINT pk_audits PRIMARY KEY (job_id), 
	CONSTRAINT fk_audits_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE, 
	CONSTRAINT fk_audits_solution_id FOREIGN KEY(solution_id) REFERENCES solutions (id) ON DELETE CASCADE
);

CREATE INDEX ix_audits_solution_id ON audits (solution_id);

CREATE TABLE "jobs" (
	id CHAR(32) NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	attempt INTEGER NOT NULL, 
	progress DOUBLE NOT NULL, 
	error JSON, 
	reused BOOLEAN NOT NULL, 
	solution_id CHAR(32), 
	problem JSON NOT NULL, 
	digest VARCHAR(64) NOT NULL, 
	owner VARCHAR(128), 
	lease_until DOUBLE, 
	created_at DOUBLE NOT NULL, 
	started_at DOUBLE, 
	finished_at DOUBLE, 
	kind VARCHAR(16) DEFAULT 'solve' NOT NULL, 
	priority INTEGER DEFAULT '0' NOT NULL, 
	ready_at DOUBLE DEFAULT '0' NOT NULL, 
	sweep_id CHAR(32), 
	key_id CHAR(32), lane SMALLINT DEFAULT 0 NOT NULL CONSTRAINT ck_jobs_lane CHECK (lane IN (0, 1, 2)), turn DOUBLE DEFAULT '0' NOT NULL, examination VARCHAR(64), facts JSON, note VARCHAR(2000), changed_at DOUBLE DEFAULT '0' NOT NULL, examined_seconds DOUBLE, alone BOOLEAN DEFAULT 0 NOT NULL, 
	CONSTRAINT pk_jobs PRIMARY KEY (id), 
	CONSTRAINT fk_jobs_solution_id FOREIGN KEY(solution_id) REFERENCES solutions (id), 
	CONSTRAINT ck_jobs_owner CHECK ((state = 'running') = (owner IS NOT NULL)), 
	CONSTRAINT ck_jobs_lease CHECK ((state = 'running') = (lease_until IS NOT NULL)), 
	CONSTRAINT ck_jobs_state CHECK (state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')), 
	CONSTRAINT fk_jobs_sweep_id FOREIGN KEY(sweep_id) REFERENCES sweeps (id) ON DELETE CASCADE, 
	CONSTRAINT ck_jobs_solution CHECK ((state = 'succeeded' AND kind = 'solve') = (solution_id IS NOT NULL)), 
	CONSTRAINT ck_jobs_kind CHECK (kind IN ('solve', 'chunk', 'atlas')), 
	CONSTRAINT ck_jobs_sweep CHECK ((kind = 'chunk') = (sweep_id IS NOT NULL))
);

CREATE INDEX ix_jobs_solution_id ON jobs (solution_id);

CREATE INDEX ix_jobs_sweep_id ON jobs (sweep_id);

CREATE INDEX ix_jobs_leases ON jobs (state, lease_until);

CREATE INDEX ix_jobs_state_id_kind ON jobs (state, id, kind);

CREATE INDEX ix_jobs_kind_id ON jobs (kind, id);

CREATE INDEX ix_jobs_queue ON jobs (state, priority DESC, lane, turn, key_id, id) WHERE state = 'queued';

CREATE INDEX ix_jobs_lanes ON jobs (state, lane, priority DESC, turn, key_id, id);

CREATE INDEX ix_jobs_of_key ON jobs (key_id, state, lane, priority, turn);

CREATE INDEX ix_jobs_changed ON jobs (changed_at, id) WHERE kind = 'solve';

CREATE TABLE atlases (
	job_id CHAR(32) NOT NULL, 
	data BLOB NOT NULL, 
	CONSTRAINT pk_atlases PRIMARY KEY (job_id), 
	CONSTRAINT fk_atlases_job_id FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE
);

CREATE TABLE solution_numbers (
	name TEXT NOT NULL, 
	value DOUBLE NOT NULL, 
	solution_id CHAR(32) NOT NULL, 
	CONSTRAINT pk_solution_numbers PRIMARY KEY (name, value, solution_id)
)
 WITHOUT ROWID

;

CREATE TRIGGER solution_numbers_made AFTER INSERT ON solutions BEGIN INSERT INTO solution_numbers (name, value, solution_id) SELECT key, value, NEW.id FROM json_each(NEW.facts) WHERE type IN ('integer', 'real') AND key NOT IN ('/body/A', '/body/B', '/body/C', '/motion/lambda'); END;

CREATE TRIGGER solution_numbers_gone AFTER DELETE ON solutions BEGIN DELETE FROM solution_numbers WHERE (name, value, solution_id) IN (SELECT key, value, OLD.id FROM json_each(OLD.facts) WHERE type IN ('integer', 'real') AND key NOT IN ('/body/A', '/body/B', '/body/C', '/motion/lambda')); END;

CREATE INDEX ix_solutions_family_id ON solutions (family, id, method, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_method_id ON solutions (method, id, family, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_tier_id ON solutions (tier, id, family, method, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_stability_id ON solutions (stability, id, family, method, tier, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_aperiodic_id ON solutions (aperiodic, id, family, method, tier, stability, created_at, "A", "B", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_created_at_id ON solutions (created_at, id, family, method, tier, stability, aperiodic, "A", "B", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX "ix_solutions_A_id" ON solutions ("A", id, family, method, tier, stability, aperiodic, created_at, "B", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX "ix_solutions_B_id" ON solutions ("B", id, family, method, tier, stability, aperiodic, created_at, "A", "C", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX "ix_solutions_C_id" ON solutions ("C", id, family, method, tier, stability, aperiodic, created_at, "A", "B", lambda_, period, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_lambda__id ON solutions (lambda_, id, family, method, tier, stability, aperiodic, created_at, "A", "B", "C", period, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_period_id ON solutions (period, id, family, method, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, energy, error, drift, trace, seconds);

CREATE INDEX ix_solutions_energy_id ON solutions (energy, id, family, method, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, error, drift, trace, seconds);

CREATE INDEX ix_solutions_error_id ON solutions (error, id, family, method, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, drift, trace, seconds);

CREATE INDEX ix_solutions_drift_id ON solutions (drift, id, family, method, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, error, trace, seconds);

CREATE INDEX ix_solutions_trace_id ON solutions (trace, id, family, method, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, error, drift, seconds);

CREATE INDEX ix_solutions_seconds_id ON solutions (seconds, id, family, method, tier, stability, aperiodic, created_at, "A", "B", "C", lambda_, period, energy, error, drift, trace);

INSERT INTO alembic_version (version_num) VALUES ('0016');

