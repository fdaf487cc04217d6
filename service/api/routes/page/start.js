"use strict";
SwaggerUIBundle({
  url: "openapi.json",
  dom_id: "#swagger-ui",
  deepLinking: true,
  defaultModelsExpandDepth: 0,
  displayRequestDuration: true,
  // A key that was typed in is forgotten with the page, and nothing is sent to other hosts.
  persistAuthorization: false,
  validatorUrl: null,
});
